"""What planning a pick returns."""

from dataclasses import dataclass

from evg_app.geometry import Array
from evg_app.types import Trajectory, Verdict


@dataclass(frozen=True)
class PickPlan:
    """Every motion of one pick, verified and ready to send.

    Attributes:
        T_base_grasp: the grasp as it will be executed (flip included). Shape (4, 4).
        reach: from where the arm is to the pre-grasp, gripper open.
        approach: straight to the grasp.
        lift: from the grasp to the lifted pose.
        transport: lifted to above the drop bin.
        retreat: lifted to the look pose, for when nothing is held.
        back: drop to the look pose.
    """

    T_base_grasp: Array
    reach: Trajectory
    approach: Trajectory
    lift: Trajectory
    transport: Trajectory
    retreat: Trajectory
    back: Trajectory

    @property
    def cycle(self) -> float:
        """Time of the motions of a pick that holds something [s]."""
        parts = (self.reach, self.approach, self.lift, self.transport, self.back)
        return float(sum(part.duration for part in parts))


@dataclass(frozen=True)
class PickDecision:
    """The verdict on every grasp, and the pick chosen.

    Attributes:
        verdicts: one per grasp, in their order.
        pick: the motions, or None when no examined grasp is feasible.
        grasp_index: which grasp, -1 without a pick.
        flipped: whether the antipodal twin of that grasp is executed.
    """

    verdicts: tuple[Verdict, ...]
    pick: PickPlan | None
    grasp_index: int = -1
    flipped: bool = False
