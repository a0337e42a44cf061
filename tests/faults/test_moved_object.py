"""An object is moved between planning and approach, in the simulator with its noise: planned again, logged as such."""

from contextlib import ExitStack

import pytest

from evg_app.cli.lab import build_lab, loop_context
from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.events import AttemptFinished, MotionEnded, SceneRechecked, Warned
from evg_app.grasping.load import load_planner
from evg_app.motion.feasibility import MotionPlanner
from evg_app.picking.run import run_rounds
from evg_app.trials.film import Film

SHIFT = 0.04
"""How far everything on the table is moved [m]."""


@pytest.mark.slow
def test_objects_moved_after_the_reach_are_noticed_and_planned_on_again():
    robot, camera = load_robot("panda"), load_camera("d435i")
    world = load_world("packed").model_copy(update={"count": 1})
    lab, events = build_lab(robot, camera, world, None, False, None), []

    def nudge(event) -> None:
        events.append(event)
        if (
            isinstance(event, MotionEnded)
            and event.name == "reach"
            and not any(isinstance(e, SceneRechecked) for e in events)
        ):
            for thing in lab.world.placed:
                (x, y, z), turn = lab.world.client.getBasePositionAndOrientation(thing.body)
                lab.world.client.resetBasePositionAndOrientation(thing.body, (x, y + SHIFT, z), turn)
        if isinstance(event, AttemptFinished):
            ctx.stop.request_soft()

    with ExitStack() as stack:
        stack.callback(lab.world.close)
        for device in (lab.camera, lab.arm, lab.gripper):
            stack.enter_context(device)
        ctx = loop_context(lab, robot, camera, load_planner("antipodal"), MotionPlanner(robot), nudge, Film())
        run_rounds(ctx, lab.rounds, (0,), 1)
    looked = [e for e in events if isinstance(e, SceneRechecked)]
    finished = [e for e in events if isinstance(e, AttemptFinished)]
    assert looked[0].changed and str(finished[0].outcome) == "replanned" and finished[0].evidence.width_closed is None
    assert "scene changed" in [e.cause for e in events if isinstance(e, Warned)]
