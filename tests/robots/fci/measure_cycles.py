"""Measures free motions and gripper cycles: `python tests/robots/fci/measure_cycles.py PEER N OUT.json [SHARE]`.

A cycle goes to a random collision-free place above the workspace and to above the bin, closes and opens the hand at
each, on planned and verified motions, with the FR3's config, at SHARE (default 1) of its speed.
"""

import json
import os
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from fci_motions import end_of
from fci_peers import OBJECT_WIDTH, PEERS, robot_at, tool_pose_of

from evg_app.errors import EvgError
from evg_app.geometry import make, rotation_about
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.slower import slowed
from evg_app.robots.fci.arm import FciArm
from evg_app.robots.fci.gripper import FciGripper
from evg_app.trials.statistics import wilson

GOAL_RAD, OPEN_M = 0.01, 0.07
CLOSED_M = {"franky-sim": 0.005, "franka-sim": OBJECT_WIDTH + 0.002}


def place(planner: MotionPlanner, rng: np.random.Generator, q: np.ndarray) -> np.ndarray:
    """Joints with the hand above the workspace, pointing down, turned at random."""
    while True:
        position = rng.uniform((0.38, -0.12, 0.25), (0.62, 0.12, 0.40))
        R = rotation_about("x", np.pi)[:3, :3] @ rotation_about("z", rng.uniform(-1.0, 1.0))[:3, :3]
        found = planner.kinematics.ik(make(R, position), q)
        if found is not None and planner.go_to(q, found) is not None:
            return np.asarray(found)


def main(name: str, cycles: int, out: Path, share: float) -> None:
    """Run the cycles and write what happened."""
    peer = PEERS[name]()
    robot = robot_at(peer.host, robot="fr3")
    planner, rng = MotionPlanner(robot), np.random.default_rng(0)
    motions, grips, lost, seconds, errors, failure = [], [], 0, [], [], ""
    try:
        with FciArm(robot, tool_pose_of(robot)) as arm, FciGripper(robot) as hand:
            try:
                for _ in range(cycles):
                    for goal in (place(planner, rng, arm.state().q), np.array(robot.drop.q_rad)):
                        way = planner.go_to(arm.state().q, goal)
                        start = time.monotonic()
                        motion = arm.execute(slowed(way, share))
                        result = end_of(motion, 120.0)
                        seconds.append(time.monotonic() - start)
                        errors.append(float(np.abs(arm.state().q - goal).max()))
                        motions.append(result.reached and errors[-1] < GOAL_RAD)
                        lost += motion.ended.lost
                        closed = hand.grasp(0.0, 0.1, 30.0, 0.08, 0.08, 20.0)
                        opened = hand.move(0.08, 0.1, 20.0)
                        grips.append(closed.success and closed.width < CLOSED_M[name] and opened.width > OPEN_M)
            except EvgError as error:
                motions.append(False)
                failure = str(error)
            received, missed, longest = arm.link_quality()
    finally:
        peer.close()
    facts = {
        "peer": name,
        "command": f"python tests/robots/fci/measure_cycles.py {name} {cycles} OUT.json {share:g}",
        "speed_share": share,
        "motions": [sum(motions), len(motions), *wilson(sum(motions), len(motions))],
        "gripper_cycles": [sum(grips), len(grips), *wilson(sum(grips), len(grips))],
        "goal_error_rad": {"median": float(np.median(errors)), "max": max(errors)},
        "motion_s": {"median": float(np.median(seconds)), "max": max(seconds)},
        "states_lost": {"lost": missed, "of": received + missed, "longest": longest, "in_motions": lost},
        "ended_early": failure,
        "load_average": os.getloadavg(),
    }
    out.write_text(json.dumps(facts, indent=2) + "\n")
    sys.stdout.write(json.dumps(facts) + "\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]), float(sys.argv[4]) if len(sys.argv) > 4 else 1.0)
