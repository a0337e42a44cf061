"""The judgement of a grasp: several signs and one rule. Every sign is logged, agreeing or not."""

from dataclasses import dataclass

from evg_app.config.evidence import EvidenceModel
from evg_app.config.models import GripperModel
from evg_app.errors import HardwareError
from evg_app.events import Evidence, Warned
from evg_app.picking.observe import arm_at_rest, healthy_frame
from evg_app.picking.session import Round


@dataclass(frozen=True)
class Signs:
    """What was seen of one grasp; None where nobody looked.

    Attributes:
        width_closed, width_lifted, width_release: openings after closing, after the lift, above the bin [m].
        width_emptied: the opening when the fingers were closed once more after they had opened above the bin [m].
        device: the device's own word after the lift.
        place_area: surface that came or went where the fingers closed [m^2].
        place_compared: share of that place that both images show.
    """

    width_closed: float | None = None
    width_lifted: float | None = None
    width_release: float | None = None
    device: bool | None = None
    place_area: float | None = None
    place_compared: float | None = None
    width_emptied: float | None = None


@dataclass(frozen=True)
class Judgement:
    """What the signs say.

    Attributes:
        held: the object was taken away.
        why: why not; empty when it was.
        disagreeing: signs that say otherwise, in words.
    """

    held: bool
    why: str = ""
    disagreeing: tuple[str, ...] = ()


def in_window(width: float, gripper: GripperModel) -> bool:
    """Whether the fingers stopped on something: not fully closed and not fully open [m]."""
    return gripper.held_width_m < width < gripper.max_width_m - gripper.open_margin_m


def gone(signs: Signs, rule: EvidenceModel) -> bool | None:
    """Whether the object has left its place; None when the look tells nothing."""
    if signs.place_area is None or signs.place_compared is None or signs.place_compared < rule.place_compared:
        return None
    return signs.place_area >= rule.place_area_m2


def judge(signs: Signs, gripper: GripperModel, rule: EvidenceModel) -> Judgement:
    """Held when the opening says so after the lift and above the bin, it left the hand there, and left its place.

    The device's word never decides: a Franka Hand says no to a held object when its window is narrow, and yes to
    thin air when it is wide.
    """
    absent = gone(signs, rule)
    if signs.width_lifted is None:
        return Judgement(False, "never lifted")
    lifted = in_window(signs.width_lifted, gripper)
    kept = signs.width_release is not None and in_window(signs.width_release, gripper)
    why = "nothing held after lift" if not lifted else "lost in transit" if not kept else ""
    if not why and signs.width_emptied is not None and signs.width_emptied > gripper.held_width_m:
        why = "still in the hand"
    if not why and absent is False:
        why = "object still in its place"
    odd = []
    if signs.device is not None and signs.device != lifted:
        odd.append(f"the device says {'held' if signs.device else 'not held'}, the opening {_mm(signs.width_lifted)}")
    if absent is not None and absent != (lifted and kept):
        odd.append(f"the place {'changed' if absent else 'did not change'}, the opening {_mm(signs.width_lifted)}")
    if signs.width_closed is not None and in_window(signs.width_closed, gripper) != lifted:
        odd.append(f"the opening went from {_mm(signs.width_closed)} to {_mm(signs.width_lifted)} in the lift")
    return Judgement(not why, why, tuple(odd))


def _mm(width: float) -> str:
    """An opening in words."""
    return f"{width * 1e3:.1f} mm"


def signs_of(seen: Evidence) -> Signs:
    """The signs among what a pass has gathered."""
    return Signs(
        seen.width_closed,
        seen.width_lifted,
        seen.width_release,
        seen.is_grasped_lifted,
        seen.place_area,
        seen.place_compared,
        seen.width_emptied,
    )


def conclude_signs(round_: Round) -> None:
    """With the arm out of the view again: look at the place, judge, and say which signs disagree.

    Where a referee knows the truth, the openings are all that is judged. A camera that fails now costs this sign, not
    the round.
    """
    attempt, ctx = round_.now, round_.ctx
    if not attempt.closed or attempt.fault:
        return
    rule = ctx.robot.evidence
    if ctx.referee is None and rule.look_at_place:
        _look(round_, rule)
    verdict = judge(signs_of(attempt.evidence), ctx.robot.gripper, rule)
    attempt.judged, attempt.judged_why = verdict.held, verdict.why
    if ctx.referee is None and verdict.disagreeing:
        round_.emit(Warned("signs disagree", "; ".join(verdict.disagreeing)))


def _look(round_: Round, rule: EvidenceModel) -> None:
    """Take one more image and compare the place with before."""
    attempt, ctx = round_.now, round_.ctx
    if attempt.frame is None or attempt.q is None or attempt.decision is None or attempt.decision.pick is None:
        return
    try:
        q = arm_at_rest(round_)
        fresh = healthy_frame(round_, q)
    except HardwareError as error:
        round_.emit(Warned("no look after the pick", str(error)))
        return
    change = ctx.perception.change(
        (attempt.frame, attempt.q),
        (fresh, q),
        attempt.decision.pick.T_base_grasp,
        rule.place_radius_m,
        rule.place_depth_m,
    )
    attempt.note(place_area=change.area, place_compared=change.compared)
