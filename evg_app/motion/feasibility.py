"""Judge ranked grasps and plan the pick: every looked-at grasp is accepted or gets the one reason against it."""

from collections.abc import Iterator

import numpy as np

from evg_app.config.models import RobotConfig
from evg_app.errors import BadInput, Refused
from evg_app.geometry import MAX_OPENING, WORKSPACE_SIZE, Array
from evg_app.motion.candidates import QUICK, THOROUGH, Effort
from evg_app.motion.collision import ArmChecker, SelfCollision
from evg_app.motion.finish import Finisher
from evg_app.motion.gripper import approach_hits, gripper_boxes, gripper_links, lift_hits
from evg_app.motion.kinematics import Kinematics
from evg_app.motion.legs import Leg, find_legs, lift_poses
from evg_app.motion.plan import PickDecision, PickPlan
from evg_app.motion.route import Router
from evg_app.motion.scene import Scene, SceneView, empty_scene, prepare
from evg_app.motion.spheres import arm_spheres
from evg_app.motion.trajectory import time_path
from evg_app.types import Grasps, Trajectory, Verdict

__all__ = ["MotionPlanner", "SceneView"]

MAX_SEARCHES = 2
"""Grasps of one decision for which blocked straight paths are worth a tree search."""
MAX_SECOND_LOOKS = 8
"""Grasps that are looked at again, closely, before a decision ends without a pick."""
SECOND_LOOK = (Verdict.IK, Verdict.JOINT_LIMIT, Verdict.SELF_COLLISION, Verdict.ARM_COLLISION)
"""Reasons that a closer look may overturn."""
LIFT_CHECKS = 8
"""Poses of the lift at which the gripper is checked against the scene."""


class MotionPlanner:
    """Feasibility and motion of one arm in its lab. Decisions are pure functions of the arguments."""

    def __init__(self, robot: RobotConfig) -> None:
        """Load the models and check the configured poses.

        Raises:
            BadInput: home, look or drop pose cannot be taken, or the robot's files do not fit the config.
        """
        self.robot = robot
        self.kinematics = Kinematics(robot)
        meshes = self.kinematics.meshes
        declared = {item.name for item in robot.attached}
        bodies = [body for body in self.kinematics.primitives if body[0] in declared]
        body = arm_spheres(meshes, gripper_links(meshes, robot), bodies)
        self.checker = ArmChecker(self.kinematics, body, SelfCollision(robot))
        self._gripper = gripper_boxes(meshes, robot, self.kinematics.geometry.T_7_hand)
        self.home_q, self.look_q = np.array(robot.home_q_rad), np.array(robot.look_q_rad)
        self.drop_q = np.array(robot.drop.q_rad)
        self._router = Router(self.checker, (self.home_q, self.look_q))
        tip = float(self._gripper.high[self._gripper.side != 0, 2].max())
        self._finisher = Finisher(robot, self._router, tip)
        self._declared = empty_scene(robot)
        for key, q in (("home_q_rad", self.home_q), ("look_q_rad", self.look_q), ("drop.q_rad", self.drop_q)):
            problem = self._problem(q, self._declared)
            if problem:
                raise BadInput(f"{key} of robot '{robot.name}' {problem}. Correct robot_configs/{robot.name}.yaml.")

    def plan_pick(
        self, grasps: Grasps, scene: SceneView, q_start: Array, *, accept: int = 1, max_examined: int = 60
    ) -> PickDecision:
        """Examine grasps in their order until `accept` are feasible; the best of them is planned in full.

        Args:
            grasps: best first, task frame.
            scene: what was observed.
            q_start: where the arm is. Shape (7,) [rad].
            accept: how many feasible grasps to look for.
            max_examined: how many grasps to look at.

        Raises:
            BadInput: q_start is not finite or outside the URDF's limits.
        """
        q_start = self._start(q_start)
        prepared = self.prepared(scene, q_start)
        verdicts = [Verdict.NOT_EXAMINED] * len(grasps)
        chosen: tuple[int, Leg, PickPlan] | None = None
        searches, accepted = MAX_SEARCHES, 0
        for index in range(min(len(grasps), max_examined)):
            if accepted >= accept:
                break
            outcome = self._judge(grasps, index, prepared, q_start, searches > 0)
            if isinstance(outcome, Verdict):
                verdicts[index] = outcome
                searches -= outcome is Verdict.NO_PATH
                continue
            verdicts[index] = Verdict.ACCEPTED
            accepted += 1
            if chosen is None:
                chosen = (index, *outcome)
        if chosen is None:
            chosen = self._second_look(grasps, verdicts, prepared, q_start)
        if chosen is None:
            return PickDecision(tuple(verdicts), None)
        return PickDecision(tuple(verdicts), chosen[2], chosen[0], chosen[1].flipped)

    def _second_look(
        self, grasps: Grasps, verdicts: list[Verdict], scene: Scene, q_start: Array
    ) -> tuple[int, Leg, PickPlan] | None:
        """Before giving up: the best grasps that only the arm did not reach, examined closely. Updates `verdicts`."""
        doubtful = [k for k, verdict in enumerate(verdicts) if verdict in SECOND_LOOK]
        for index in doubtful[:MAX_SECOND_LOOKS]:
            outcome = self._judge(grasps, index, scene, q_start, True, THOROUGH)
            if not isinstance(outcome, Verdict):
                verdicts[index] = Verdict.ACCEPTED
                return (index, *outcome)
        return None

    def go_to(self, q_start: Array, q_goal: Array, scene: SceneView | None = None) -> Trajectory:
        """A verified, collision-checked motion; without a scene only declared boxes, table and arm count.

        Raises:
            BadInput: a configuration is not finite, or outside the joint limits.
            Refused: the goal collides, or no path was found.
        """
        q_start, q_goal = self._start(q_start), self._start(q_goal)
        prepared = self._declared
        if scene is not None:
            prepared = self.prepared(scene, q_start)
        path = self._router.connect(q_start, q_goal, prepared)
        if path is None:
            problem = self._problem(q_goal, prepared) or "cannot be reached without collision"
            raise Refused(f"the goal {np.round(q_goal, 3).tolist()} {problem}; the arm stays where it is")
        return time_path(path, self.robot)

    def _start(self, q: Array) -> Array:
        """q as floats, refused when it is no configuration of this arm."""
        q = np.asarray(q, dtype=np.float64)
        if q.shape != (7,) or not np.isfinite(q).all():
            raise BadInput(f"a configuration needs 7 finite joint positions, got {q.tolist()}; nothing was planned")
        if not self.kinematics.possible(q):
            low, high = self.kinematics.model.lowerPositionLimit, self.kinematics.model.upperPositionLimit
            joint = int(np.argmax(np.maximum(low - q, q - high)))
            allowed = f"[{low[joint]:.4f}, {high[joint]:.4f}]"
            raise BadInput(f"{self.robot.joints[joint]} = {q[joint]:.4f} rad is outside its limits {allowed}")
        return q

    def _problem(self, q: Array, scene: Scene) -> str:
        """Why the arm cannot be at q (7,), or an empty string."""
        if not self.kinematics.inside_limits(q):
            return "is outside the joint limits or within position_margin_rad of them"
        if self.checker.self_collision.collides(q):
            return f"makes the arm collide with itself: {self.checker.self_collision.what_collides(q)}"
        if self.checker.hits_scene(q[None], scene)[0]:
            return f"touches {self.checker.what_is_hit(q, scene)}"
        return ""

    def _judge(
        self, grasps: Grasps, index: int, scene: Scene, q_start: Array, search: bool, effort: Effort = QUICK
    ) -> tuple[Leg, PickPlan] | Verdict:
        """Cheap tests first; the first that fails is the reason."""
        T_task_grasp, width = grasps.T_task_grasp[index], float(grasps.width[index])
        position = T_task_grasp[:3, 3]
        if not (np.isfinite(T_task_grasp).all() and (position >= 0).all() and (position <= WORKSPACE_SIZE).all()):
            return Verdict.OUT_OF_WORKSPACE
        if not 0.0 < width <= min(self.robot.gripper.max_width_m, MAX_OPENING):
            return Verdict.WIDTH
        T_base_grasp = self.robot.T_base_task.matrix() @ T_task_grasp
        if self._gripper_hits(scene, T_base_grasp, width):
            return Verdict.GRIPPER_COLLISION
        free = self.free_legs(scene, T_base_grasp, q_start, effort)
        if isinstance(free, Verdict):
            return free
        return self._finisher.plan(free, scene, T_base_grasp, width, q_start, search)

    def _gripper_hits(self, scene: Scene, T_base_grasp: Array, width: float) -> bool:
        """Whether the gripper touches something on approach or lift of a grasp (4, 4)."""
        robot = self.robot
        if approach_hits(self._gripper, scene, T_base_grasp, robot.gripper.max_width_m, robot.pregrasp_m):
            return True
        poses = lift_poses(robot, T_base_grasp)
        poses = poses[np.linspace(0, len(poses) - 1, LIFT_CHECKS + 1).astype(int)[1:]]
        return lift_hits(self._gripper, scene, T_base_grasp, poses, width)

    def prepared(self, scene: SceneView, q_start: Array) -> Scene:
        """What all checks work on: `scene` without what the arm itself occupies at q_start (7,)."""
        return prepare(self.robot, scene, self.kinematics.link_primitives(q_start))

    def free_legs(
        self, scene: Scene, T_base_grasp: Array, q_start: Array, effort: Effort = QUICK
    ) -> Iterator[Leg] | Verdict:
        """Straight executions of a grasp along which the arm (without the gripper) touches nothing, cheapest first."""
        legs = find_legs(self.robot, self.checker, scene, T_base_grasp, q_start, effort)
        if isinstance(legs, Verdict):
            return legs
        return (leg for leg in legs if self.leg_is_free(leg, scene))

    def leg_is_free(self, leg: Leg, scene: Scene) -> bool:
        """Whether the arm (without the gripper) touches nothing on straight approach and lift."""
        check = self._router.strict(scene, gripper=False)
        pregrasp = leg.approach.at(np.zeros(1))
        if self.checker.hits_scene(pregrasp, scene)[0]:
            return False
        return self._router.is_free(leg.approach, check) and self._router.is_free(leg.lift, check)
