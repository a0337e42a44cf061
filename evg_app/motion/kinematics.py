"""The arm's kinematics: Pinocchio's model, vectorised forward kinematics, closed-form inverse kinematics."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from evg_app.config.models import RobotConfig
from evg_app.config.robot_files import collision_urdf, package_folder, resolve
from evg_app.errors import BadInput
from evg_app.geometry import Array, invert, transform_points
from evg_app.motion.franka_ik import BRANCHES, FrankaGeometry, solve
from evg_app.types import Capsule

Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

Q7_SAMPLES = 36
"""Values of the free joint q7 that inverse kinematics tries."""
GEOMETRY_TOLERANCE = 1e-4
"""How far a URDF's joint placements may be from a Franka arm's [m, or entries of the rotation]."""
LIMIT_WEIGHT = 0.3
"""Weight [s] of the closeness to joint limits against travel time when solutions are ranked."""


@dataclass(frozen=True)
class IkSolutions:
    """Joint configurations that reach one pose, inside the limits, best first.

    Attributes:
        q: shape (K, 7) [rad].
        branch: which of the closed form's solutions each is. Shape (K,).
        cost: shape (K,) [s], see `Kinematics.cost`.
        any_without_limits: whether the pose is reachable when joint limits are ignored.
    """

    q: Array
    branch: Integers
    cost: Array
    any_without_limits: bool


def load_arm(robot: RobotConfig, urdf: Path) -> tuple[Any, Any]:
    """Pinocchio model and collision geometry of the arm, every other joint locked with the fingers open.

    Raises:
        BadInput: the URDF cannot be read, or lacks the configured joints in their order, or the hand.
    """
    try:
        full = pin.buildModelFromUrdf(str(urdf))
        folders = [str(package_folder(urdf))]
        geometry = pin.buildGeomFromUrdf(full, str(urdf), pin.GeometryType.COLLISION, package_dirs=folders)
    except (ValueError, RuntimeError) as error:
        raise BadInput(f"{urdf} cannot be read as a URDF: {error}") from error
    wanted = list(robot.model_joints)
    arm = [name for name in full.names if name in wanted]
    if arm != wanted:
        raise BadInput(f"{urdf} has the joints {list(full.names)[1:]}, the config wants {wanted} in order")
    _frame(full, urdf, robot.model_hand_link, "hand_link")
    locked = [full.getJointId(name) for name in list(full.names)[1:] if name not in wanted]
    q = np.asarray(pin.neutral(full))
    for joint in locked:
        q[full.joints[joint].idx_q] = robot.gripper.max_width_m / 2
    model, geometry = pin.buildReducedModel(full, geometry, locked, q)
    if robot.limits.position_rad:
        model.lowerPositionLimit, model.upperPositionLimit = np.array(robot.limits.position_rad).T
    return model, geometry


def _frame(model: Any, urdf: Path, link: str, key: str) -> Any:
    """The frame of a link.

    Raises:
        BadInput: there is none; the message lists those that exist.
    """
    if not model.existFrame(link):
        links = sorted(frame.name for frame in model.frames)
        raise BadInput(f"{urdf} has no link '{link}' ({key}); its frames: {', '.join(links)}")
    return model.frames[model.getFrameId(link)]


class Kinematics:
    """Forward and inverse kinematics of one Franka-like arm. Immutable apart from Pinocchio's scratch data."""

    def __init__(self, robot: RobotConfig) -> None:
        """Load the model.

        Raises:
            BadInput: the URDF does not fit the config, or is not an arm with a Franka's geometry.
        """
        urdf = resolve(robot.urdf)
        self.robot = robot
        self.model, self.meshes = load_arm(robot, urdf)
        self.geometry = _franka_geometry(self.model, robot)
        margin = robot.limits.position_margin_rad
        self.lower: Array = np.asarray(self.model.lowerPositionLimit) + margin
        self.upper: Array = np.asarray(self.model.upperPositionLimit) - margin
        self.middle: Array = (self.lower + self.upper) / 2
        self.speed: Array = np.asarray(robot.limits.velocity_rad_s) * robot.limits.velocity_scale
        self._placements = self.geometry.placements()
        self.primitives = primitives(robot)

    def frames(self, q: Array) -> Array:
        """Frames of the base and the seven joints in the base frame. Shapes (N, 7) -> (N, 8, 4, 4)."""
        P, c, s = self._placements, np.cos(q)[..., None], np.sin(q)[..., None]
        turned = np.empty((len(q), 7, 4, 4))
        turned[..., 0] = P[:, :, 0] * c + P[:, :, 1] * s
        turned[..., 1] = P[:, :, 1] * c - P[:, :, 0] * s
        turned[..., 2:] = P[:, :, 2:]
        T = np.empty((len(q), 8, 4, 4))
        T[:, 0] = np.eye(4)
        for j in range(7):
            np.matmul(T[:, j], turned[:, j], out=T[:, j + 1])
        return T

    def fk_hand(self, q: Array) -> Array:
        """T_base_hand of one configuration (7,) or of several (N, 7). Shape (4, 4) or (N, 4, 4)."""
        q = np.asarray(q, dtype=np.float64)
        T: Array = self.frames(np.atleast_2d(q))[:, 7] @ self.geometry.T_7_hand
        return T[0] if q.ndim == 1 else T

    def inside_limits(self, q: Array) -> Flags:
        """Whether configurations (..., 7) are inside the joint limits minus the margin; False for NaN. Shape (...)."""
        return np.asarray(((q >= self.lower - 1e-9) & (q <= self.upper + 1e-9)).all(axis=-1))

    def possible(self, q: Array) -> Flags:
        """Whether configurations (..., 7) are inside the URDF's joint limits, without margin. Shape (...)."""
        margin = self.robot.limits.position_margin_rad
        return np.asarray(((q >= self.lower - margin - 1e-9) & (q <= self.upper + margin + 1e-9)).all(axis=-1))

    def wrap(self, q: Array) -> Array:
        """Angles turned by multiples of 2 pi to be nearest to the middle of their joint's range. Shape (..., 7)."""
        wrapped: Array = q - 2 * np.pi * np.round((q - self.middle) / (2 * np.pi))
        return wrapped

    def closed_form(self, T_base_hand: Array, q7: Array) -> Array:
        """All solutions of poses (M, 4, 4) with given q7 (M,), limits ignored, NaN where none. Shape (M, 8, 7)."""
        return self.wrap(solve(self.geometry, T_base_hand, q7))

    def cost(self, q: Array, reference: Array) -> Array:
        """Time of the slowest joint from `reference` (7,) at full speed, plus a penalty near limits [s]. (...)."""
        travel = (np.abs(q - reference) / self.speed).max(axis=-1)
        closeness = np.abs(2 * (q - self.middle) / (self.upper - self.lower)).max(axis=-1)
        cost: Array = travel + LIMIT_WEIGHT * closeness**4
        return cost

    def search(self, T_base_hand: Array, reference: Array, q7: Array | None = None) -> IkSolutions:
        """Every solution of one pose (4, 4) over a grid of q7 (default: the whole range), cheapest first."""
        if q7 is None:
            grid = np.linspace(self.lower[6], self.upper[6], Q7_SAMPLES)
            near = np.clip(reference[6], self.lower[6], self.upper[6])
            q7 = np.concatenate([[near], grid])
        found = self.closed_form(np.broadcast_to(T_base_hand, (len(q7), 4, 4)), q7)
        any_at_all = bool(np.isfinite(found).all(axis=-1).any())
        rows, branch = np.nonzero(self.inside_limits(found))
        q = found[rows, branch]
        cost = self.cost(q, reference)
        order = np.argsort(cost, kind="stable")
        return IkSolutions(q[order], branch[order], cost[order], any_at_all)

    def solutions(self, T_base_hand: Array, seeds: Array) -> list[Array]:
        """Configurations inside the limits that reach a pose (4, 4), best first.

        Args:
            T_base_hand: shape (4, 4).
            seeds: shape (S, 7) or (7,) [rad]; the first is the reference that closeness is measured from, and each
                seed's q7 is tried beside the grid.
        """
        seeds = np.atleast_2d(seeds)
        grid = np.linspace(self.lower[6], self.upper[6], Q7_SAMPLES)
        q7 = np.concatenate([np.clip(seeds[:, 6], self.lower[6], self.upper[6]), grid])
        return list(self.search(T_base_hand, seeds[0], q7).q)

    def ik(self, T_base_hand: Array, seed_q: Array) -> Array | None:
        """The best configuration (7,) for a pose (4, 4) as seen from `seed_q` (7,), or None when there is none."""
        found = self.search(T_base_hand, np.asarray(seed_q, dtype=np.float64)).q
        return found[0] if len(found) else None

    def follow(self, T_base_hand: Array, q7: Array, branch: Integers) -> Array:
        """Configurations along poses (K, 4, 4) with q7 and branch (C,) held. NaN where none. Shape (C, K, 7)."""
        K, C = len(T_base_hand), len(q7)
        poses = np.broadcast_to(T_base_hand, (C, K, 4, 4)).reshape(-1, 4, 4)
        found = self.closed_form(poses, np.repeat(q7, K)).reshape(C, K, BRANCHES, 7)
        path: Array = found[np.arange(C), :, branch]
        return path

    def link_primitives(self, q: Array) -> list[Capsule]:
        """The links, hand and open fingers as capsules in the base frame, from the primitive collision model."""
        T = self.frames(np.asarray(q, dtype=np.float64)[None])[0]
        return [
            Capsule(T[j, :3, :3] @ p0 + T[j, :3, 3], T[j, :3, :3] @ p1 + T[j, :3, 3], radius, name)
            for name, j, p0, p1, radius in self.primitives
        ]


def _franka_geometry(model: Any, robot: RobotConfig) -> FrankaGeometry:
    """Read the lengths off the URDF and check that nothing else differs from a Franka arm."""
    T = [np.asarray(model.jointPlacements[j + 1].homogeneous) for j in range(model.njoints - 1)]
    hand = model.frames[model.getFrameId(robot.model_hand_link)]
    if len(T) == 7 and all(model.joints[j + 1].shortname() == "JointModelRZ" for j in range(7)):
        d1, d3, a4, d5, a7 = (float(x) for x in (T[0][2, 3], -T[2][1, 3], T[3][0, 3], T[4][1, 3], T[6][0, 3]))
        geometry = FrankaGeometry(d1, d3, a4, d5, a7, np.asarray(hand.placement.homogeneous))
        if np.abs(np.stack(T) - geometry.placements()).max() < GEOMETRY_TOLERANCE and hand.parentJoint == 7:
            return geometry
    raise BadInput(
        f"{robot.urdf} is not an arm with the joint geometry of a Franka Panda or FR3; no other is supported"
    )


Primitive = tuple[str, int, Array, Array, float]
"""A capsule fixed to a joint's frame: link, frame, both ends and radius [m]."""


def primitives(robot: RobotConfig) -> list[Primitive]:
    """Spheres and cylinders (as capsules) of the collision model without spheres that end a capsule; declared bodies.

    Raises:
        BadInput: a declared body is on a link that does not exist.
    """
    urdf = collision_urdf(resolve(robot.urdf))
    model, geometry = load_arm(robot, urdf)
    capsules: list[Primitive] = []
    for item in sorted(geometry.geometryObjects, key=lambda g: not hasattr(g.geometry, "halfLength")):
        radius = getattr(item.geometry, "radius", None)
        if radius is None:
            continue
        half = getattr(item.geometry, "halfLength", 0.0) * np.asarray(item.placement.rotation)[:, 2]
        centre = np.asarray(item.placement.translation)
        name = item.name.rsplit("_", 1)[0]
        new = (name, int(item.parentJoint), centre - half, centre + half, float(radius))
        if not any(_covers(old, new) for old in capsules):
            capsules.append(new)
    return capsules + attached(robot, model, urdf)


def attached(robot: RobotConfig, model: Any, urdf: Path) -> list[Primitive]:
    """The declared bodies on the arm.

    Raises:
        BadInput: one is on a link that does not exist.
    """
    bodies: list[Primitive] = []
    for body in robot.attached:
        frame = _frame(model, urdf, body.link, f"attached: {body.name}")
        T = np.asarray(frame.placement.homogeneous)
        ends = transform_points(T, np.array([body.from_m, body.to_m]))
        bodies.append((body.name, int(frame.parentJoint), ends[0], ends[1], body.radius_m))
    return bodies


def _covers(old: Primitive, new: Primitive) -> bool:
    """Whether capsule `old` contains the sphere `new`, to a millimetre."""
    if old[0] != new[0] or np.abs(new[2] - new[3]).max() > 0:
        return False
    axis = old[3] - old[2]
    along = np.clip((new[2] - old[2]) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
    return bool(np.linalg.norm(new[2] - old[2] - along * axis) + new[4] <= old[4] + 1e-3)


def hand_to_grasp(robot: RobotConfig) -> Array:
    """T_hand_grasp of this gripper (spec §1). Shape (4, 4)."""
    T = np.eye(4)
    T[2, 3] = robot.gripper.hand_to_grasp_z_m
    return T


def hand_of_grasp(robot: RobotConfig, T_base_grasp: Array) -> Array:
    """T_base_hand for grasps T_base_grasp. Shape (..., 4, 4)."""
    T_base_hand: Array = T_base_grasp @ invert(hand_to_grasp(robot))
    return T_base_hand
