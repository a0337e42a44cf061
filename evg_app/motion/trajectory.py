"""Time a joint path with one-dimensional ruckig along its parameter, and verify what will be sent.

Timing along the path keeps the motion on the path that was checked for collisions. With q(s(t)):
dq = q' s', ddq = q'' s'^2 + q' s'', dddq = q''' s'^3 + 3 q'' s' s'' + q' s'''. Bounds on q', q'', q''' along the path
turn the joint limits into limits of s', s'', s'''.
"""

from functools import cache

import numpy as np
from ruckig import InputParameter, Result, Ruckig
from ruckig import Trajectory as Profile

from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput, LimitViolation, Refused
from evg_app.geometry import Array
from evg_app.motion.kinematics import Kinematics
from evg_app.motion.path import JointPath
from evg_app.types import Trajectory

DT = 0.004
"""Sample interval of every trajectory [s]."""
TOLERANCE = 1e-6
"""Relative excess that the verifier forgives."""
SHARES = (1.0, 0.9, 0.75, 0.6, 0.45, 0.3, 0.2, 0.1)
"""Fractions of the highest path speed that timing tries; a slower path leaves more acceleration on curves."""
MIN_LENGTH = 1e-9
"""A path shorter than this is a stand-still [rad]."""


def limits(robot: RobotConfig) -> tuple[Array, Array, Array]:
    """Velocity [rad/s], acceleration [rad/s^2] and jerk [rad/s^3] that evg-app allows itself. Shape (J,) each."""
    m = robot.limits
    return (
        np.asarray(m.velocity_rad_s) * m.velocity_scale,
        np.asarray(m.acceleration_rad_s2) * m.acceleration_scale,
        np.asarray(m.jerk_rad_s3) * m.jerk_scale,
    )


def time_path(path: JointPath, robot: RobotConfig) -> Trajectory:
    """The fastest rest-to-rest trajectory along a path that constant limits of s', s'', s''' allow, verified.

    Raises:
        LimitViolation: the path itself leaves the joint limits.
        Refused: no timing keeps the limits.
    """
    if path.length < MIN_LENGTH:
        q = np.repeat(path.at(np.zeros(1)), 2, axis=0)
        return _checked(Trajectory(tuple(robot.joints), DT, q, np.zeros_like(q), np.zeros_like(q)), robot)
    scale = 1.0
    for _ in range(6):
        trajectory = _sample(path, _fastest(path, robot, scale), robot)
        try:
            return _checked(trajectory, robot)
        except LimitViolation as violation:
            if violation.quantity == "position":
                raise
            scale *= 0.85
    raise Refused("no timing of this path keeps velocity, acceleration and jerk limits; check limits in the config")


def _fastest(path: JointPath, robot: RobotConfig, scale: float) -> Profile:
    """The shortest profile of s over several splits of the limits, stretched to whole samples."""
    velocity, acceleration, jerk = (x * scale for x in limits(robot))
    d1, d2, d3 = (np.abs(path.at(path.critical(), n)) for n in (1, 2, 3))
    steep = np.maximum(d1, 1e-12)
    top = float((velocity / steep).min())
    best: tuple[float, tuple[float, float, float]] | None = None
    for share in SHARES:
        v = share * top
        a = float(((acceleration - d2 * v * v) / steep).min())
        j = float(((jerk - d3 * v**3 - 3 * d2 * v * max(a, 0.0)) / steep).min())
        if a <= 0 or j <= 0:
            a = a / 2
            j = float(((jerk - d3 * v**3 - 3 * d2 * v * max(a, 0.0)) / steep).min())
        if a <= 0 or j <= 0:
            continue
        duration = _profile(path.length, v, a, j, None).duration
        if best is None or duration < best[0]:
            best = (duration, (v, a, j))
    if best is None:
        raise Refused("the path bends too sharply for the joint limits at every speed that was tried")
    duration, bounds = best
    return _profile(path.length, *bounds, float(np.ceil(duration / DT - 1e-9)) * DT)


def _profile(length: float, v: float, a: float, j: float, duration: float | None) -> Profile:
    """Rest-to-rest motion of s from 0 to `length` within |s'| <= v, |s''| <= a, |s'''| <= j.

    Raises:
        Refused: ruckig finds none.
    """
    wanted = InputParameter(1)
    wanted.current_position, wanted.target_position = [0.0], [length]
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = [v], [a], [j]
    if duration is not None:
        wanted.minimum_duration = duration
    profile = Profile(1)
    result = Ruckig(1).calculate(wanted, profile)
    if result not in (Result.Working, Result.Finished):
        raise Refused(f"ruckig cannot time a path of length {length:.4g} ({result}); check the limits in the config")
    return profile


def _sample(path: JointPath, profile: Profile, robot: RobotConfig) -> Trajectory:
    s, ds, dds = _evaluate(profile)
    s[-1], ds[-1], dds[-1] = path.length, 0.0, 0.0
    s = np.clip(s, 0.0, path.length)
    q, d1, d2 = (path.at(s, n) for n in (0, 1, 2))
    dq = d1 * ds[:, None]
    ddq = d2 * (ds**2)[:, None] + d1 * dds[:, None]
    return Trajectory(tuple(robot.joints), DT, q, dq, ddq)


def _evaluate(profile: Profile) -> tuple[Array, Array, Array]:
    """s, s', s'' of a one-dimensional profile every `DT`: its seven phases of constant jerk. Shape (M,) each."""
    phases = profile.profiles[0][0]
    count = int(np.ceil(profile.duration / DT - 1e-6))
    t = np.arange(count + 1) * DT
    begins = np.concatenate([[0.0], np.cumsum(phases.t)])
    phase = np.clip(np.searchsorted(begins, t, side="right") - 1, 0, 6)
    tau = t - begins[phase]
    j, a, v, p = (np.asarray(x)[phase] for x in (phases.j, phases.a, phases.v, phases.p))
    return p + tau * (v + tau * (a / 2 + tau * j / 6)), v + tau * (a + tau * j / 2), a + tau * j


def _checked(trajectory: Trajectory, robot: RobotConfig) -> Trajectory:
    verify(trajectory, robot)
    for array in (trajectory.q, trajectory.dq, trajectory.ddq):
        array.setflags(write=False)
    return trajectory


@cache
def position_limits(robot: RobotConfig) -> tuple[Array, Array]:
    """Lowest and highest joint positions of the URDF, without margin. Shape (J,) [rad] each."""
    model = Kinematics(robot).model
    return np.asarray(model.lowerPositionLimit), np.asarray(model.upperPositionLimit)


def verify(trajectory: Trajectory, robot: RobotConfig) -> None:
    """Recompute velocity, acceleration and jerk from the position samples alone and compare with the limits.

    The arm is taken to rest before the first and after the last sample. The trajectory's own dq and ddq must keep the
    limits too, and agree with the positions.

    Raises:
        BadInput: wrong joints, shapes or sample interval, or values that are not finite.
        LimitViolation: which joint breaks which limit, by how much.
    """
    _well_formed(trajectory, robot)
    velocity, acceleration, jerk = limits(robot)
    low, high = position_limits(robot)
    middle, half = (low + high) / 2, (high - low) / 2
    dt = trajectory.dt
    rest = np.concatenate(
        [np.repeat(trajectory.q[:1], 3, axis=0), trajectory.q, np.repeat(trajectory.q[-1:], 3, axis=0)]
    )
    first, second, third = (np.diff(rest, n=n, axis=0) / dt**n for n in (1, 2, 3))
    _compare(trajectory, "position", trajectory.q - middle, half)
    _compare(trajectory, "velocity", first, velocity)
    _compare(trajectory, "acceleration", second, acceleration)
    _compare(trajectory, "jerk", third, jerk)
    _compare(trajectory, "velocity", trajectory.dq, velocity)
    _compare(trajectory, "acceleration", trajectory.ddq, acceleration)
    centred = (rest[4:-2] - rest[2:-4]) / (2 * dt)
    _compare(trajectory, "velocity", trajectory.dq - centred, jerk * dt**2 + 1e-6)
    _compare(trajectory, "acceleration", trajectory.ddq - second[2:-2], jerk * dt * 2 + 1e-4)


def _well_formed(trajectory: Trajectory, robot: RobotConfig) -> None:
    shape = (len(trajectory.q), len(robot.joints))
    if trajectory.joint_names != tuple(robot.joints):
        raise BadInput(f"the trajectory moves {trajectory.joint_names}, the robot has {tuple(robot.joints)}")
    for name in ("q", "dq", "ddq"):
        array = getattr(trajectory, name)
        if array.shape != shape or shape[0] < 2:
            raise BadInput(f"trajectory.{name} has shape {array.shape}, needed is {shape} with at least 2 samples")
        if not np.isfinite(array).all():
            raise BadInput(f"trajectory.{name} holds values that are not finite; nothing was sent")
    if not trajectory.dt > 0:
        raise BadInput(f"the sample interval is {trajectory.dt} s; it must be positive")


def _compare(trajectory: Trajectory, quantity: str, value: Array, limit: Array) -> None:
    excess = np.abs(value) / limit
    row, joint = np.unravel_index(int(np.argmax(excess)), excess.shape)
    if excess[row, joint] > 1.0 + TOLERANCE:
        name = trajectory.joint_names[int(joint)]
        raise LimitViolation(name, quantity, float(value[row, joint]), float(limit[joint]))
