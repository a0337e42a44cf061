"""A whole stand-in bench from a mode and a seed."""

from dataclasses import dataclass

import numpy as np

from evg_app.config.calibration import Mode
from evg_app.config.models import CameraConfig, RobotConfig
from evg_app.geometry import Array, make
from evg_app.handeye.boards import Board
from evg_app.handeye.collect import Bench, OnSample
from evg_app.handeye.poses import Reach
from evg_app.handeye.rigid import exp
from evg_app.handeye.standin.devices import Faults, StandInArm, StandInCamera, stand_in
from evg_app.handeye.standin.world import Truth, draw_truth
from evg_app.motion.feasibility import MotionPlanner


@dataclass(frozen=True)
class SimulatedBench:
    """A bench and its truth; hand only `bench` and what it collects to a solver."""

    bench: Bench
    truth: Truth


def simulated_bench(
    motion: MotionPlanner,
    robot: RobotConfig,
    camera: CameraConfig,
    board: Board,
    mode: Mode,
    seed: int,
    on_sample: OnSample,
    faults: Faults | None = None,
) -> SimulatedBench:
    """A random lab, the same for the same seed.

    Raises:
        BadInput: the robot leaves no room to show the board.
    """
    truth = draw_truth(mode, seed, Reach(motion), board, camera.simulated_intrinsics())
    world = stand_in(truth, motion.kinematics, board, seed, faults)
    arm, eye = StandInArm(world), StandInCamera(world, camera.frame_id)
    return SimulatedBench(Bench(arm, eye, world, motion, robot, camera, board, mode, on_sample), truth)


def one_axis_stops(simulated: SimulatedBench, count: int, seed: int) -> list[Array]:
    """What a hurried user does: the hand only turns about its own z, and shifts. Configurations (J,)."""
    motion, rng = simulated.bench.motion, np.random.default_rng([seed, 9])
    start = motion.kinematics.fk_hand(simulated.truth.q_start)
    reach, stops = Reach(motion), [simulated.truth.q_start]
    for _ in range(20 * count):
        turn = exp(np.array([0.0, 0.0, rng.uniform(-0.45, 0.45)]))
        q = reach.configuration(start @ make(turn, rng.uniform(-0.05, 0.05, 3)), stops[-1])
        if q is not None:
            stops.append(q)
        if len(stops) == count:
            break
    return stops
