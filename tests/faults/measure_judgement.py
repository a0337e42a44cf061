"""Is the judgement of a grasp true? `python tests/faults/measure_judgement.py SCENE FIRST LAST OUT.jsonl`.

Rounds FIRST to LAST - 1 of seed 0 in simulation, as on hardware without a referee; the truth is kept apart.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

from evg_app.cli.lab import build_lab, loop_context
from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.events import AttemptFinished, Event, RoundStarted
from evg_app.grasping.load import load_planner
from evg_app.motion.feasibility import MotionPlanner
from evg_app.picking.run import run_rounds
from evg_app.trials.film import Film

SEED = 0
SIGNS = ("width_lifted", "width_release", "width_emptied", "place_area", "place_compared")


def main(scene: str, first: int, last: int, out: Path) -> None:
    """Run the rounds, and append a line for every attempt that was judged."""
    robot, camera = load_robot("panda"), load_camera("d435i")
    lab = build_lab(robot, camera, load_world(scene), None, False, None)
    before = 0

    def keep(event: Event) -> None:
        """Compare a judgement with the truth."""
        nonlocal before
        if isinstance(event, RoundStarted):
            before = 0
        if isinstance(event, AttemptFinished):
            now = len(lab.world.truth().in_bin)
            if event.outcome.counts and event.verified is not None:
                seen = {name: getattr(event.evidence, name) for name in SIGNS}
                row = {"scene": scene, "attempt": event.attempt_id, "held": event.verified, "true": now > before}
                with out.open("a") as stream:
                    stream.write(json.dumps(row | {"failure": event.failure} | seen) + "\n")
            before = now

    with lab.camera, lab.arm, lab.gripper:
        planner = load_planner("equiigd", None, "cpu")
        ctx = loop_context(lab, robot, camera, planner, MotionPlanner(robot), keep, Film())
        alone = replace(ctx, referee=None, tick=lambda: None)
        run_rounds(alone, lab.rounds, (SEED,), last, {(SEED, index) for index in range(first)})


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
