"""Models of the parts of a robot's YAML file that describe the arm itself: limits, and what is fixed to its links."""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from evg_app.config.base import Model, Positive, Vector3
from evg_app.geometry import Array

Share = Annotated[float, Field(gt=0, le=1)]
NotNegative = Annotated[float, Field(ge=0)]


class NearEnds(Model):
    """Franka's rule for the FR3: a joint may move towards an end at most at sqrt(gain * distance) - offset.

    Attributes:
        lower_rad, upper_rad: ends that the distance is measured to [rad]; a little outside the joint's range.
        gain: [rad/s^2].
        offset_rad_s: [rad/s].
    """

    lower_rad: tuple[float, ...]
    upper_rad: tuple[float, ...]
    gain: tuple[Positive, ...]
    offset_rad_s: tuple[NotNegative, ...]

    def velocity(self, q: Array) -> tuple[Array, Array]:
        """Largest speed towards the lower and the upper ends at q (..., J), 0 or more. Shape (..., J) each [rad/s]."""
        distances = (q - np.asarray(self.lower_rad), np.asarray(self.upper_rad) - q)
        gain, offset = np.asarray(self.gain), np.asarray(self.offset_rad_s)
        down, up = (np.maximum(np.sqrt(gain * np.maximum(d, 0.0)) - offset, 0.0) for d in distances)
        return down, up


class JointLimits(Model):
    """Limits of the J joints, before the margin `scale` is applied.

    Attributes:
        position_rad: lowest and highest position of each joint, where they differ from the URDF's [rad].
        near_ends: speed limits that shrink towards the ends of the joints, if the arm has such.
    """

    velocity_rad_s: tuple[Positive, ...]
    acceleration_rad_s2: tuple[Positive, ...]
    jerk_rad_s3: tuple[Positive, ...]
    position_rad: tuple[tuple[float, float], ...] = ()
    near_ends: NearEnds | None = None
    velocity_scale: Share = 0.5
    acceleration_scale: Share = 0.3
    jerk_scale: Share = 0.3
    carry_scale: Share = 0.6
    position_margin_rad: Annotated[float, Field(ge=0, lt=0.5)] = 0.03

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for k, (low, high) in enumerate(self.position_rad):
            if high - low <= 2 * self.position_margin_rad:
                raise ValueError(f"position_rad of joint {k + 1} leaves nothing between {low} and {high}")
        return self

    def vectors(self) -> dict[str, tuple[object, ...]]:
        """Every entry that needs one value for each joint, by its key."""
        found: dict[str, tuple[object, ...]] = {
            "limits.velocity_rad_s": self.velocity_rad_s,
            "limits.acceleration_rad_s2": self.acceleration_rad_s2,
            "limits.jerk_rad_s3": self.jerk_rad_s3,
        }
        if self.position_rad:
            found["limits.position_rad"] = self.position_rad
        if self.near_ends is not None:
            found |= {f"limits.near_ends.{key}": value for key, value in dict(self.near_ends).items()}
        return found


class AttachedBody(Model):
    """Something fixed to a link: a camera bracket, cables, other fingers. All within `radius_m` of a line.

    Attributes:
        name: how reports call it.
        link: name of the URDF's link that carries it.
        from_m, to_m: ends of the line in that link's frame [m].
        radius_m: [m].
    """

    name: str
    link: str
    from_m: Vector3
    to_m: Vector3
    radius_m: Positive
