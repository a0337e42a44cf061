"""Model of the `fci:` part of a robot's YAML file: the Franka Control Interface."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from evg_app.config.base import Model, Positive

Seven = tuple[Positive, Positive, Positive, Positive, Positive, Positive, Positive]
Three = tuple[Positive, Positive, Positive]


class FciModel(Model):
    """How to talk to a Franka arm without ROS.

    Attributes:
        host: the arm's address, as in Desk.
        arm: which arm stands there: "fr3" (Franka Research 3) or "fer" (Panda).
        realtime: "auto" asks for real-time scheduling when the kernel has it, "enforce" refuses without, "ignore"
            never asks.
        priority: of the streaming process under SCHED_FIFO, where allowed.
        core: CPU that the streaming process is bound to; None takes the last one when there are four or more.
        collision_torque_nm: per joint; above it the arm stops with a reflex [Nm].
        collision_force_n: at the tool, along x y z [N].
        collision_moment_nm: at the tool, about x y z [Nm].
        hand_mass_kg: mass of the end effector that Desk should have been told [kg].
        load_mass_kg: of what is fixed to the hand beside it, a camera for example [kg].
        load_center_m: its centre of mass in the flange frame [m].
        look_away_s: the motion is stopped when the loop has not looked at it for this long [s].
    """

    host: str = "172.16.0.2"
    arm: Literal["fr3", "fer"] = "fr3"
    realtime: Literal["auto", "enforce", "ignore"] = "auto"
    priority: int = Field(default=80, ge=1, le=98)
    core: int | None = Field(default=None, ge=0)
    collision_torque_nm: Seven = (25.0, 25.0, 22.0, 20.0, 19.0, 17.0, 14.0)
    collision_force_n: Three = (30.0, 30.0, 30.0)
    collision_moment_nm: Three = (25.0, 25.0, 25.0)
    hand_mass_kg: Positive = 0.73
    load_mass_kg: Annotated[float, Field(ge=0, le=3)] = 0.0
    load_center_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    look_away_s: Annotated[float, Field(ge=0.2, le=10)] = 2.0


class ToolBox(Model):
    """Where the tool centre point may go, in the base frame. A software limit, not a safety function."""

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if any(a >= b for a, b in zip(self.low_m, self.high_m, strict=True)):
            raise ValueError(f"low_m {self.low_m} must be below high_m {self.high_m} in every axis")
        return self
