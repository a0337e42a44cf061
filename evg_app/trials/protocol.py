"""What a round of a protocol asks of the operator: a function of protocol and round alone, so any round can resume."""

from dataclasses import dataclass

import numpy as np

from evg_app.config.protocol import ProtocolConfig

ANGLE_STEP = 15
"""Objects are turned by multiples of this [deg]: what a hand can do."""


@dataclass(frozen=True)
class RoundPlan:
    """One round.

    Attributes:
        index: from 0.
        objects: in the order they are placed; "object 1" and so on when the protocol names none.
        turns_deg: of each about the vertical.
    """

    index: int
    objects: tuple[str, ...]
    turns_deg: tuple[int, ...]

    def lines(self, protocol: ProtocolConfig) -> list[str]:
        """What the operator reads before the round."""
        head = f"{protocol.name}: round {self.index + 1} of {protocol.rounds}"
        steps = [f"  {i}. {step}" for i, step in enumerate(protocol.placement, 1)]
        table = [f"     {name:<22}{turn:>4} deg" for name, turn in zip(self.objects, self.turns_deg, strict=True)]
        return [head, *steps, *table]

    def facts(self) -> dict[str, object]:
        """As JSON, for the log."""
        return {"objects": list(self.objects), "turns_deg": list(self.turns_deg)}


def plan_round(protocol: ProtocolConfig, index: int, seed: int | None = None) -> RoundPlan:
    """Which objects, in which order, turned how far; drawn from (seed, index) alone."""
    rng = np.random.default_rng([protocol.seed if seed is None else seed, index])
    n = protocol.objects_per_round
    pool = protocol.objects or tuple(f"object {i + 1}" for i in range(n))
    chosen = tuple(pool[i] for i in rng.permutation(len(pool))[:n])
    turns = tuple(int(turn) for turn in ANGLE_STEP * rng.integers(0, 360 // ANGLE_STEP, n))
    return RoundPlan(index, chosen, turns)
