"""What one scene of the motion benchmark says; JSON in and out."""

from dataclasses import asdict, dataclass
from typing import Any, Self

from evg_app.errors import BadInput

TRUE, BASELINE, OBSERVED = "true", "baseline", "observed"
"""Arms of the experiment: planned on true geometry, straight joint interpolation, planned on one noisy view.

The last is followed by the policy for unknown space: "observed optimistic".
"""


TIMES = ("scene_ms", "check_ms", "legs_ms", "path_ms", "timing_ms")
"""Fields of a row that hold times."""


@dataclass(frozen=True)
class Target:
    """One grasp whose reachability was tested.

    Attributes:
        owner: index of its object.
        configuration: the exhaustive search found a configuration at the grasp where the arm touches nothing.
        legs: and one with straight approach and lift on which it touches nothing.
        found: the planner's own search found such approach and lift.
        picked: the planner made a whole pick of it: gripper, object in hand, free paths and timing included.
        verdict: the planner's word on the whole pick.
    """

    owner: int
    configuration: bool
    legs: bool
    found: bool
    picked: bool
    verdict: str


@dataclass(frozen=True)
class Cycle:
    """One pick of one arm of the experiment.

    Attributes:
        arm: see `TRUE`, `BASELINE`, `OBSERVED`.
        owner: index of the object.
        ended: "done", why a motion fell short, or "no pick: " and the planner's verdicts.
        contacts: before closing, with anything but the target: "phase: link - other (mm)".
        after: the same after closing.
        target_before: whether the target was touched before closing.
        held, delivered: after the lift, and whether the target ended in the bin.
        ratios: shares of the limits that the sent samples reach.
        broken: limits that they break.
        seconds: simulated [s].
        still, moved: changed area that the look before the approach found [m^2]: with nothing moved, and with the
            target moved by 3 cm; None without that look.
    """

    arm: str
    owner: int
    ended: str
    contacts: tuple[str, ...] = ()
    after: tuple[str, ...] = ()
    target_before: bool = False
    held: bool = False
    delivered: bool = False
    ratios: dict[str, float] | None = None
    broken: tuple[str, ...] = ()
    seconds: float = 0.0
    still: float | None = None
    moved: float | None = None

    @property
    def executed(self) -> bool:
        """Whether the arm moved."""
        return self.ratios is not None


@dataclass(frozen=True)
class SceneRow:
    """Everything about one scene.

    Attributes:
        seed, number, kind: which.
        objects: names in order of placement.
        grasps: how many targets the labels gave.
        targets: reachability.
        cycles: what was executed.
        scene_ms: CPU times to prepare the observed scene [ms].
        check_ms: CPU times until one candidate that reached the test of arm against scene has its answer: inverse
            kinematics over both flips, self-collision, arm against scene [ms].
        legs_ms: CPU times from there to its first straight approach and lift on which the arm is free [ms].
        path_ms: CPU times from there to all six timed motions [ms].
        timing_ms: CPU times to time and verify one motion [ms].
        git_commit: of the code that ran it.
    """

    seed: int
    number: int
    kind: str
    objects: tuple[str, ...]
    grasps: int
    targets: tuple[Target, ...]
    cycles: tuple[Cycle, ...]
    scene_ms: tuple[float, ...]
    check_ms: tuple[float, ...]
    legs_ms: tuple[float, ...]
    path_ms: tuple[float, ...]
    timing_ms: tuple[float, ...]
    git_commit: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The opposite of `to_dict`.

        Raises:
            BadInput: the values are not a scene's.
        """
        try:
            flat = {k: tuple(values[k]) for k in ("objects", *TIMES)}
            targets = tuple(Target(**target) for target in values["targets"])
            lists = ("contacts", "after", "broken")
            cycles = tuple(Cycle(**(c | {k: tuple(c[k]) for k in lists})) for c in values["cycles"])
            return cls(**(values | flat | {"targets": targets, "cycles": cycles}))
        except (TypeError, KeyError) as error:
            raise BadInput(f"not a scene of the motion benchmark: {error}; delete the file, or name another") from error
