"""The simulated lab: the devices, the truth and the film that `evg-app run --sim` hands to the loop."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from evg_app.config.models import CameraConfig, RobotConfig, WorldConfig
from evg_app.events import Sink
from evg_app.grasping.protocol import Planner
from evg_app.motion.feasibility import MotionPlanner
from evg_app.picking.context import Context, Devices
from evg_app.picking.motion import PlannedMotion
from evg_app.picking.perceive import TablePerception
from evg_app.simulation.arm import SimulatedArm
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.camera import SimulatedCamera, spectate
from evg_app.simulation.gripper import SimulatedGripper
from evg_app.simulation.objects import objects_from_folder
from evg_app.simulation.world import SimClock, SimReferee, SimRounds, SimWorld
from evg_app.trials.film import Film

FILM_INTERVAL = 0.2
"""Simulated time between two frames of the film [s]."""


@dataclass(frozen=True)
class SimLab:
    """One simulated lab.

    Attributes:
        world: the physics.
        camera, arm, gripper, clock: the devices, not yet entered.
        referee, rounds: who knows the truth and who sets the table.
    """

    world: SimWorld
    camera: SimulatedCamera
    arm: SimulatedArm
    gripper: SimulatedGripper
    clock: SimClock
    referee: SimReferee
    rounds: SimRounds


def build_lab(
    robot: RobotConfig,
    camera: CameraConfig,
    world_config: WorldConfig,
    objects: Path | None,
    gui: bool,
    speed: float | None,
) -> SimLab:
    """A lab with objects that no shipped weights were trained on, or those of a folder.

    Raises:
        BadInput: the objects folder is unusable.
    """
    models = objects_from_folder(objects) if objects else builtin_objects("test")
    world = SimWorld(robot, world_config, models, gui=gui, speed=speed)
    return SimLab(
        world,
        SimulatedCamera(world, camera),
        SimulatedArm(world),
        SimulatedGripper(world),
        SimClock(world),
        SimReferee(world),
        SimRounds(world),
    )


def loop_context(
    lab: SimLab,
    robot: RobotConfig,
    camera: CameraConfig,
    planner: Planner,
    motion: MotionPlanner,
    sink: Sink,
    film: Film,
) -> Context:
    """What the loop needs of a lab whose devices are entered. The camera stands still, so its pose is constant."""
    perception = TablePerception(
        lab.world.T_base_task,
        lambda q: lab.camera.T_base_cam,
        motion.kinematics.link_primitives,
        camera.table_is_ruler,
        camera.min_valid_ratio,
    )
    return Context(
        devices=Devices(lab.camera, lab.arm, lab.gripper, lab.clock),
        perception=perception,
        planner=planner,
        motion=PlannedMotion(motion),
        robot=robot,
        camera=camera,
        sink=sink,
        referee=lab.referee,
        tick=filming(lab.world, film),
    )


def filming(world: SimWorld, film: Film) -> Callable[[], None]:
    """A tick that adds a picture of the whole scene every `FILM_INTERVAL`."""
    due = 0.0

    def tick() -> None:
        """Add a picture when one is due."""
        nonlocal due
        if world.time >= due:
            due = world.time + FILM_INTERVAL
            film.add(spectate(world))

    return tick
