"""The robot in PyBullet: the configured URDF with real mesh paths, joint numbers by name, finger contact."""

import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet

from evg_app.config.cache import cache_folder
from evg_app.config.models import RobotConfig
from evg_app.config.robot_files import package_folder, resolve
from evg_app.errors import BadInput
from evg_app.geometry import Array
from evg_app.simulation.bullet import Client

FINGER_FRICTION, FINGER_SPINNING = 1.0, 0.1
"""Lateral and spinning friction of the finger tips (spec §1)."""
FINGER_STIFFNESS, FINGER_DAMPING = 30000.0, 1000.0
"""Contact stiffness [N/m] and damping [Ns/m] of the finger tips (spec §1)."""
FINGER_MASS = 0.1
"""Mass of one finger with its share of the drive [kg] (spec §1)."""


@dataclass(frozen=True)
class RobotBody:
    """A loaded robot.

    Attributes:
        body: PyBullet body id.
        joints: joint numbers of the arm, in the config's order.
        efforts: largest torque of each arm joint [Nm]. Shape (J,).
        fingers: joint (and link) numbers of the two fingers.
        hand: link number of the hand.
    """

    body: int
    joints: tuple[int, ...]
    efforts: Array
    fingers: tuple[int, int]
    hand: int


def resolved_urdf(robot: RobotConfig, detailed: bool) -> Path:
    """A cached copy of the robot's URDF whose meshes have real paths.

    Without `detailed` the coarse collision meshes are drawn instead of the large visual ones: they load 100
    times faster and render 4 times faster.

    Raises:
        BadInput: the URDF is missing, or the cache cannot be written.
    """
    urdf = resolve(robot.urdf)
    text = urdf.read_text(encoding="utf-8").replace("package://", f"{package_folder(urdf).as_posix()}/")
    if not detailed:
        text = re.sub(r"meshes/visual/(\w+)\.dae", r"meshes/collision/\1.stl", text)
    name = f"{urdf.stem}_{hashlib.sha256(text.encode()).hexdigest()[:16]}.urdf"
    copy = cache_folder() / "robots" / name
    if not copy.is_file():
        try:
            copy.parent.mkdir(parents=True, exist_ok=True)
            scratch = copy.with_suffix(f".{hashlib.sha256(np.random.default_rng().bytes(8)).hexdigest()[:8]}")
            scratch.write_text(text, encoding="utf-8")
            scratch.replace(copy)
        except OSError as error:
            raise BadInput(f"cannot write {copy} ({error.strerror}). Point XDG_CACHE_HOME elsewhere.") from error
    return copy


def load_robot(client: Client, robot: RobotConfig, detailed: bool = False) -> RobotBody:
    """Load the robot at the world's origin, coupled fingers open, arm at `look_q_rad`.

    Raises:
        BadInput: the URDF lacks a configured joint, the hand, or two prismatic fingers.
    """
    body = int(client.loadURDF(str(resolved_urdf(robot, detailed)), useFixedBase=True))
    infos = [client.getJointInfo(body, k) for k in range(client.getNumJoints(body))]
    by_name = {info[1].decode(): k for k, info in enumerate(infos)}
    links = {info[12].decode(): k for k, info in enumerate(infos)}
    fingers = [k for k, info in enumerate(infos) if info[2] == pybullet.JOINT_PRISMATIC]
    missing = [name for name in robot.model_joints if name not in by_name]
    if missing or robot.model_hand_link not in links or len(fingers) != 2:
        raise BadInput(
            f"{robot.urdf} lacks joints {missing}, the hand link '{robot.model_hand_link}' "
            f"or 2 fingers (has {len(fingers)})"
        )
    joints = tuple(by_name[name] for name in robot.model_joints)
    efforts = np.array([infos[k][10] for k in joints])
    loaded = RobotBody(body, joints, efforts, (fingers[0], fingers[1]), links[robot.model_hand_link])
    _prepare(client, loaded, robot)
    return loaded


def _prepare(client: Client, robot: RobotBody, config: RobotConfig) -> None:
    for joint, q in zip(robot.joints, config.look_q_rad, strict=True):
        client.resetJointState(robot.body, joint, q)
    for finger in robot.fingers:
        client.resetJointState(robot.body, finger, config.gripper.max_width_m / 2)
        client.changeDynamics(
            robot.body,
            finger,
            mass=FINGER_MASS,
            lateralFriction=FINGER_FRICTION,
            spinningFriction=FINGER_SPINNING,
            contactStiffness=FINGER_STIFFNESS,
            contactDamping=FINGER_DAMPING,
        )
    for link in range(-1, client.getNumJoints(robot.body)):
        client.changeDynamics(robot.body, link, linearDamping=0.0, angularDamping=0.0)
        client.changeVisualShape(robot.body, link, rgbaColor=(0.93, 0.93, 0.95, 1.0))
    for link in (robot.hand, *robot.fingers):
        client.changeVisualShape(robot.body, link, rgbaColor=(0.35, 0.36, 0.40, 1.0))
    gear = client.createConstraint(
        robot.body, robot.fingers[0], robot.body, robot.fingers[1], pybullet.JOINT_GEAR, [1, 0, 0], [0, 0, 0], [0, 0, 0]
    )
    client.changeConstraint(gear, gearRatio=-1, erp=0.1, maxForce=50)


def external_wrench(client: Client, robot: RobotBody, tcp: Array) -> Array:
    """Contact force [N] and torque [Nm] about `tcp` [m] on the moving links, in the base frame. Shape (6,)."""
    wrench = np.zeros(6)
    for contact in client.getContactPoints(bodyA=robot.body):
        if contact[3] < 0 or contact[2] == robot.body:
            continue
        force = contact[9] * np.asarray(contact[7])
        force = force + contact[10] * np.asarray(contact[11]) + contact[12] * np.asarray(contact[13])
        wrench[:3] += force
        wrench[3:] += np.cross(np.asarray(contact[5]) - tcp, force)
    return wrench
