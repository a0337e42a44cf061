"""Further views: a camera on the hand looks from several poses before the one that is planned from."""

import numpy as np

from evg_app.events import ViewTaken
from evg_app.picking.devices import go_to
from evg_app.picking.observe import arm_at_rest, healthy_frame
from evg_app.picking.session import Round
from evg_app.types import MotionResult


def look_around(round_: Round) -> MotionResult | None:
    """Take a clean frame from each of the robot's `view_q_rad`, for this pass. The motion that fell short, or None.

    Raises:
        HardwareError: the camera gave no usable frame, or as `go_to`.
    """
    attempt, perception = round_.now, round_.ctx.perception
    attempt.further.clear()
    for index, pose in enumerate(round_.ctx.robot.view_q_rad):
        went = go_to(round_, f"view {index + 1}", np.asarray(pose, dtype=np.float64))
        if not went.reached:
            return went
        q = arm_at_rest(round_)
        frame = healthy_frame(round_, q)
        round_.emit(ViewTaken(index, frame, q, perception.T_base_cam(q)))
        attempt.further.append((perception.clean(frame, q), q))
    return None
