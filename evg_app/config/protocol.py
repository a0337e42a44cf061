"""A published procedure for trials (`sim/protocols/<name>.yaml`): what an operator does, and what is counted."""

from pathlib import Path
from typing import Literal, Self

from pydantic import Field, model_validator

from evg_app.config.files import find, read
from evg_app.config.models import Model


class ProtocolConfig(Model):
    """One procedure.

    Attributes:
        source: where it was published.
        scene: the world of `sim/worlds/` that is its simulated twin.
        rounds, objects_per_round: how much.
        seed: of the objects and orders of every round.
        objects: names that rounds draw from without repetition; empty when the lab does not name its objects.
        placement: what the operator does before each round, one line a step.
        label: whether the operator is asked after every attempt, or never.
    """

    name: str
    description: str
    source: str
    scene: str
    rounds: int = Field(gt=0, le=1000)
    objects_per_round: int = Field(gt=0, le=30)
    seed: int = Field(default=0, ge=0)
    objects: tuple[str, ...] = ()
    placement: tuple[str, ...] = Field(min_length=1)
    label: Literal["every attempt", "never"] = "every attempt"

    @model_validator(mode="after")
    def _enough(self) -> Self:
        if self.objects and len(set(self.objects)) < len(self.objects):
            raise ValueError("objects names the same object twice")
        if self.objects and len(self.objects) < self.objects_per_round:
            raise ValueError(f"objects has {len(self.objects)} names for rounds of {self.objects_per_round}")
        return self


def load_protocol(name: str, config_dir: Path | None = None) -> ProtocolConfig:
    """The protocol of that name.

    Raises:
        UnknownName: there is none; the message lists those that exist.
        ConfigError: with file and line.
    """
    return read(find("protocol", "sim/protocols", name, config_dir), ProtocolConfig)
