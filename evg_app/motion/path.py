"""Joint paths: curves q(s) that are twice continuously differentiable, and where to look at them."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, CubicSpline

from evg_app.geometry import Array

LINE_KNOTS = 2
SHORTEST = 1e-9
"""A path shorter than this stands still [rad]."""


class Curve(Protocol):
    """A piecewise cubic of scipy."""

    def __call__(self, s: Array, nu: int = 0) -> Array:
        """The nu-th derivative at s (M,). Shape (M, J)."""


@dataclass(frozen=True)
class _Segment:
    """The straight line from `start` along `direction` (J,), with the interface of a curve."""

    start: Array
    direction: Array

    def __call__(self, s: Array, nu: int = 0) -> Array:
        """q at s (M,), or its derivative of order nu. Shape (M, J)."""
        if nu == 0:
            return np.asarray(self.start + np.asarray(s)[:, None] * self.direction)
        value: Array = np.zeros((len(s), len(self.direction)))
        if nu == 1:
            value += self.direction
        return value


@dataclass(frozen=True)
class JointPath:
    """A curve q(s), s from 0 to `length`.

    Attributes:
        curve: piecewise cubic.
        length: end of the parameter [rad]; close to the arc length in joint space.
        knots: where the third derivative may jump. Shape (K,).
        waypoints: the configurations it was made from. Shape (W, J).
        stops: whether the motion must be at rest at every knot, because the curve has corners there.
    """

    curve: Curve
    length: float
    knots: Array
    waypoints: Array
    stops: bool = False

    def at(self, s: Array, derivative: int = 0) -> Array:
        """q or a derivative with respect to s. Shapes (M,) -> (M, J)."""
        value: Array = np.asarray(self.curve(s, derivative), dtype=np.float64)
        return value

    def even(self, count: int) -> Array:
        """`count` configurations, evenly spaced in s, both ends included. Shape (count, J)."""
        return self.at(np.linspace(0.0, self.length, count))

    def critical(self) -> Array:
        """Parameters that show the extremes of the first three derivatives."""
        inner = (self.knots[:-1] + self.knots[1:]) / 2
        thirds = np.linspace(0.0, self.length, 65)
        return np.unique(np.concatenate([self.knots, inner, thirds]))

    @property
    def end(self) -> Array:
        """The last configuration. Shape (J,)."""
        last: Array = self.waypoints[-1]
        return last


def line(a: Array, b: Array) -> JointPath:
    """The straight path in joint space."""
    length = float(np.linalg.norm(b - a))
    waypoints = np.stack([a, b])
    if length < SHORTEST:
        return JointPath(_Segment(a, np.zeros_like(a)), 0.0, np.array([0.0, 1.0]), waypoints)
    return JointPath(_Segment(a, (b - a) / length), length, np.array([0.0, length]), waypoints)


def through(waypoints: Array) -> JointPath:
    """A natural cubic spline through configurations (W, J) that lie close together, such as those of a Cartesian line.

    With two waypoints it is the straight line.
    """
    if len(waypoints) == LINE_KNOTS:
        return line(waypoints[0], waypoints[1])
    length = float(np.linalg.norm(np.diff(waypoints, axis=0), axis=1).sum())
    if length < SHORTEST:
        still = np.repeat(waypoints[:1], 2, axis=0)
        return JointPath(CubicSpline([0.0, 1.0], still, bc_type="natural"), 0.0, np.array([0.0, 1.0]), waypoints)
    # Even spacing when the steps are alike: the speed along the curve then has no wiggles.
    steps = np.maximum(np.linalg.norm(np.diff(waypoints, axis=0), axis=1), 1e-3 * length / len(waypoints))
    s = np.concatenate([[0.0], np.cumsum(steps)])
    s *= length / s[-1]
    return JointPath(CubicSpline(s, waypoints, axis=0, bc_type="natural"), length, s, waypoints)


def blended(waypoints: Array, intervals: int) -> JointPath:
    """A cubic B-spline that follows the polyline through `waypoints` (W, J) and rounds its corners.

    Its control points are the polyline at the Greville abscissae, so straight stretches stay exact; more `intervals`
    keep it closer to the corners. It never leaves the convex hull of four neighbouring control points.
    """
    steps = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    waypoints = waypoints[np.concatenate([[True], steps > 1e-9])]
    if len(waypoints) <= LINE_KNOTS:
        return through(waypoints)
    reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(waypoints, axis=0), axis=1))])
    length = float(reached[-1])
    knots = np.linspace(0.0, length, intervals + 1)
    full = np.concatenate([[0.0] * 3, knots, [length] * 3])
    greville = np.convolve(full[1:-1], np.ones(3) / 3, mode="valid")
    control = np.stack([np.interp(greville, reached, column) for column in waypoints.T], axis=1)
    return JointPath(BSpline(full, control, 3), length, knots, waypoints)


def polyline(waypoints: Array) -> JointPath:
    """Straight from waypoint to waypoint (W, J), with a stop at each."""
    steps = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    waypoints = waypoints[np.concatenate([[True], steps > 1e-9])]
    if len(waypoints) <= LINE_KNOTS:
        return through(waypoints)
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(waypoints, axis=0), axis=1))])
    curve = BSpline(np.concatenate([[0.0], knots, knots[-1:]]), waypoints, 1)
    return JointPath(curve, float(knots[-1]), knots, waypoints, stops=True)


def bezier_lift(start: Array, approach: Array, height: float, back_off: float, count: int) -> Array:
    """Positions (count, 3) [m] of a lift: first back along the approach, then bending to straight up.

    Args:
        start: where it begins [m]. Shape (3,).
        approach: unit vector of the grasp's approach. Shape (3,).
        height: rise of the end above the start [m].
        back_off: how far it first follows the negative approach [m]; 0 for straight up.
        count: positions.
    """
    up = np.array([0.0, 0.0, 1.0])
    corner = start - approach * back_off
    end = corner + up * max(height - float((corner - start)[2]), 0.02)
    t = np.linspace(0.0, 1.0, count)[:, None]
    if back_off == 0.0:
        return start + (end - start) * t
    # Degree three with both inner points at the corner: tangent to both legs, without a corner.
    weights = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3)
    curve: Array = weights[0] * start + (weights[1] + weights[2]) * corner + weights[3] * end
    return curve
