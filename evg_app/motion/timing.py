"""How fast to go along a path: profiles of the path parameter s from one-dimensional ruckig.

With q(s(t)): dq = q' s', ddq = q'' s'^2 + q' s'', dddq = q''' s'^3 + 3 q'' s' s'' + q' s'''. Bounds of q', q'', q'''
over a section of the path turn the joint limits into constant limits of s', s'', s''' there. A path of straight
stretches and rounded corners is timed in sections: corners at constant s', the straights with the full limits.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from ruckig import InputParameter, Result, Ruckig, Trajectory

from evg_app.errors import Refused
from evg_app.geometry import Array
from evg_app.motion.path import JointPath

SPEED_SHARES = (1.0, 0.9, 0.75, 0.6, 0.45, 0.3, 0.2, 0.1)
"""Fractions of the highest path speed that are tried; a slower path leaves more acceleration on curves."""
ACCELERATION_SHARES = (1.0, 0.7, 0.4)
"""Fractions of the acceleration left on the path that are tried; a lower one leaves more jerk."""
STRAIGHT = 1e-7
"""Largest |q''| of a straight stretch [1/rad]."""

Limits = tuple[Array, Array, Array]
"""Velocity, acceleration and jerk of the joints, shape (J,) each."""


@dataclass(frozen=True)
class Bounds:
    """Limits of s', s'', s''' over a stretch of the path."""

    v: float
    a: float
    j: float

    def run_up(self, v0: float, v1: float) -> float:
        """Length of s needed to change s' from v0 to v1, s'' being zero before and after."""
        change = abs(v1 - v0)
        a = self.a
        time = change / a + a / self.j if change >= a * a / self.j else 2 * float(np.sqrt(change / self.j))
        return (v0 + v1) / 2 * time


@dataclass(frozen=True)
class Timing:
    """s(t) as a sequence of ruckig profiles: start of each in s, and the profile."""

    pieces: tuple[tuple[float, Trajectory], ...]

    @property
    def duration(self) -> float:
        """Time from rest to rest [s]."""
        return float(sum(profile.duration for _, profile in self.pieces))

    def sample(self, dt: float) -> tuple[Array, Array, Array]:
        """s, s', s'' every `dt` [s], slowed by less than one sample to end on one. Shape (M,) each."""
        count = max(int(np.ceil(self.duration / dt - 1e-9)), 1)
        slower = self.duration / (count * dt)
        t = np.arange(count + 1) * dt * slower
        s, ds, dds = np.zeros((3, count + 1))
        begin = 0.0
        for offset, profile in self.pieces:
            rows = (t >= begin - 1e-12) & (t <= begin + profile.duration + 1e-12)
            s[rows], ds[rows], dds[rows] = _evaluate(profile, t[rows] - begin)
            s[rows] += offset
            begin += profile.duration
        return s, ds * slower, dds * slower**2


def fastest(path: JointPath, limits: Limits) -> Timing:
    """The quickest rest-to-rest timing of a path that this method finds.

    Raises:
        Refused: the path bends too sharply for every speed that is tried.
    """
    if path.stops:
        return _stop_and_go(path, limits)
    whole = _whole(path, limits)
    sections = _sections(path)
    if len(sections) > 2 and sections[0][2] and sections[-1][2]:
        try:
            in_sections = _in_sections(path, sections, limits)
        except Refused:
            return whole
        if in_sections.duration < whole.duration:
            return in_sections
    return whole


def _stop_and_go(path: JointPath, limits: Limits) -> Timing:
    """From knot to knot, at rest at each."""
    pieces = []
    for a, b in pairwise(path.knots.tolist()):
        bounds = _splits(path, np.array([(a + b) / 2]), limits)[0]
        pieces.append((a, _profile(b - a, bounds, 0.0, 0.0)))
    return Timing(tuple(pieces))


def _whole(path: JointPath, limits: Limits) -> Timing:
    """One profile with the same limits everywhere; the best of several splits between speed and acceleration."""
    best: Timing | None = None
    for bounds in _splits(path, path.critical(), limits):
        timing = Timing(((0.0, _profile(path.length, bounds, 0.0, 0.0)),))
        if best is None or timing.duration < best.duration:
            best = timing
    if best is None:
        raise Refused("the path bends too sharply for the joint limits at every speed that was tried")
    return best


def _splits(path: JointPath, s: Array, limits: Limits) -> list[Bounds]:
    """Possible limits of s', s'', s''' at the parameters s (M,)."""
    velocity, acceleration, jerk = limits
    d1, d2, d3 = (np.abs(path.at(s, n)) for n in (1, 2, 3))
    steep = np.maximum(d1, 1e-12)
    found = []
    for share in SPEED_SHARES:
        v = share * float((velocity / steep).min())
        left = float(((acceleration - d2 * v * v) / steep).min())
        for a in (left * part for part in ACCELERATION_SHARES):
            j = float(((jerk - d3 * v**3 - 3 * d2 * v * max(a, 0.0)) / steep).min())
            if a > 0 and j > 0:
                found.append(Bounds(v, a, j))
    return found


def _sections(path: JointPath) -> list[tuple[float, float, bool]]:
    """Runs of straight and of curved knot intervals: start, end, whether straight."""
    sections: list[tuple[float, float, bool]] = []
    for a, b in pairwise(path.knots.tolist()):
        inside = np.linspace(a, b, 5)
        straight = bool(np.abs(path.at(inside, 2)).max() < STRAIGHT)
        if sections and sections[-1][2] == straight:
            sections[-1] = (sections[-1][0], b, straight)
        else:
            sections.append((a, b, straight))
    return sections


def _in_sections(path: JointPath, sections: list[tuple[float, float, bool]], limits: Limits) -> Timing:
    """Constant speed through corners, full limits on the straights."""
    corners = [_corner_speed(path, a, b, limits) for a, b, straight in sections if not straight]
    straights = [_splits(path, np.linspace(a, b, 3), limits)[0] for a, b, straight in sections if straight]
    lengths = [b - a for a, b, straight in sections if straight]
    speeds = _reachable([0.0, *corners, 0.0], straights, lengths)
    pieces: list[tuple[float, Trajectory]] = []
    k = 0
    for a, b, straight in sections:
        bounds = straights[k] if straight else Bounds(speeds[k], straights[0].a, straights[0].j)
        v0, v1 = (speeds[k], speeds[k + 1]) if straight else (speeds[k], speeds[k])
        pieces.append((a, _profile(b - a, bounds, v0, v1)))
        k += straight
    return Timing(tuple(pieces))


def _corner_speed(path: JointPath, a: float, b: float, limits: Limits) -> float:
    """Highest constant s' on a stretch."""
    inner = path.knots[(path.knots >= a - 1e-12) & (path.knots <= b + 1e-12)]
    s = np.unique(np.concatenate([inner, (inner[:-1] + inner[1:]) / 2, np.linspace(a, b, 33)]))
    speeds = [
        np.min((limit / np.maximum(np.abs(path.at(s, n)), 1e-12)) ** (1 / n)) for n, limit in enumerate(limits, start=1)
    ]
    return float(min(speeds))


def _reachable(speeds: list[float], straights: list[Bounds], lengths: list[float]) -> list[float]:
    """Lower speeds between straights until every straight is long enough to change from one to the next."""
    speeds = list(speeds)
    for k, bounds in enumerate(straights):
        for end in (k, k + 1):
            speeds[end] = min(speeds[end], bounds.v)
    for _ in range(2):
        for k, (bounds, length) in enumerate(zip(straights, lengths, strict=True)):
            fast = k + int(speeds[k + 1] > speeds[k])
            slow = 2 * k + 1 - fast
            while bounds.run_up(speeds[slow], speeds[fast]) > 0.98 * length:
                speeds[fast] = speeds[slow] + 0.9 * (speeds[fast] - speeds[slow])
                if speeds[fast] - speeds[slow] < 1e-6:
                    raise Refused("a straight stretch is too short to change the speed of the path")
    for k, (bounds, length) in enumerate(zip(straights, lengths, strict=True)):
        if bounds.run_up(speeds[k], speeds[k + 1]) > length:
            raise Refused("a straight stretch is too short to change the speed of the path")
    return speeds


def _profile(length: float, bounds: Bounds, v0: float, v1: float) -> Trajectory:
    """Motion of s over `length` within the bounds, s' from v0 to v1 and s'' zero at both ends.

    Raises:
        Refused: ruckig finds none.
    """
    wanted = InputParameter(1)
    wanted.current_position, wanted.target_position = [0.0], [length]
    wanted.current_velocity, wanted.target_velocity = [v0], [v1]
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = [bounds.v], [bounds.a], [bounds.j]
    profile = Trajectory(1)
    result = Ruckig(1).calculate(wanted, profile)
    if result not in (Result.Working, Result.Finished):
        raise Refused(f"ruckig cannot time a path of length {length:.4g} ({result}); check the limits in the config")
    return profile


def _evaluate(profile: Trajectory, t: Array) -> tuple[Array, Array, Array]:
    """s, s', s'' at times t (M,): seven phases of constant jerk."""
    phases = profile.profiles[0][0]
    begins = np.concatenate([[0.0], np.cumsum(phases.t)])
    phase = np.clip(np.searchsorted(begins, t, side="right") - 1, 0, 6)
    tau = t - begins[phase]
    j, a, v, p = (np.asarray(x)[phase] for x in (phases.j, phases.a, phases.v, phases.p))
    return p + tau * (v + tau * (a / 2 + tau * j / 6)), v + tau * (a + tau * j / 2), a + tau * j
