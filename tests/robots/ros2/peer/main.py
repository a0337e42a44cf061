"""The peer: real action servers in a process of their own, on a PyBullet arm, with faults on request.

Names are those of franka_ros2. One thread: physics, then whatever ROS wants, then whatever the test wants.
"""

import argparse
import collections
import os
import queue
import threading
import time
from multiprocessing.connection import Listener

import numpy as np
import rclpy
from asked import CONTROLLERS, Asked
from control_msgs.action import FollowJointTrajectory, GripperCommand
from controller_manager_msgs.srv import SetHardwareComponentState, SwitchController
from fingers import Fingers
from franka_msgs.action import ErrorRecovery, Grasp, Homing, Move
from franka_msgs.msg import FrankaRobotState
from hand import Hand
from jtc import Controller, refusal
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.camera import SimulatedCamera
from evg_app.simulation.panda import external_wrench
from evg_app.simulation.world import SimRounds, SimWorld

DT = 1.0 / 240.0
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")


class Peer(Asked, Fingers):
    def __init__(self, options):
        scene = load_world(options.scene).model_copy(update={"count": options.objects})
        self.world = SimWorld(load_robot("panda"), scene, builtin_objects("test"))
        self.camera = SimulatedCamera(self.world, load_camera("d435i"))
        self.rounds = SimRounds(self.world)
        self.names = self.world.robot_config.joints
        self.jtc, self.hand = Controller(self.world), Hand(self.world)
        self.speed, self.objects = options.speed, 0
        self.faults = {}
        self.wire = collections.deque(maxlen=500)
        self.mode, self.errors = 2, ()
        self.hardware, self.controllers = True, set(CONTROLLERS)
        self.late = collections.deque()
        self.pending = []
        rclpy.init()
        self.node = rclpy.create_node("peer")
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)
        self.publish(options)
        self.serve(options)

    # what it publishes

    def publish(self, options):
        node = self.node
        self.joint_pub = node.create_publisher(JointState, "/joint_states", 10)
        self.finger_pub = node.create_publisher(JointState, "/franka_gripper/joint_states", 10)
        self.state_pub = node.create_publisher(FrankaRobotState, "/franka_robot_state_broadcaster/robot_state", 10)
        self.stop_pub = node.create_publisher(Empty, "/evg_app/stop", 1)
        self.timers = [
            [1.0 / options.rate, 0.0, self.send_joints],
            [1.0 / 15.0, 0.0, self.send_fingers],
            [1.0 / min(options.rate, 30.0), 0.0, self.send_state],
        ]

    def publish_due(self):
        """Before anything else: a busy computer may slow the physics down, not the state."""
        now = time.monotonic()
        for timer in self.timers:
            if now >= timer[1]:
                timer[1] = now + timer[0]
                timer[2]()

    def stamp(self):
        return self.node.get_clock().now().to_msg()

    def send_joints(self):
        if "joint_state_broadcaster" not in self.controllers or self.faults.get("mute_joints"):
            return
        q, dq = self.jtc.joints()
        message = JointState(name=list(self.names), position=q.tolist(), velocity=dq.tolist())
        message.header.stamp = self.stamp()
        self.late.append((time.monotonic() + self.faults.get("late_joints", 0.0), message))
        while self.late and self.late[0][0] <= time.monotonic():
            self.joint_pub.publish(self.late.popleft()[1])

    def send_fingers(self):
        if self.faults.get("mute_fingers"):
            return
        q, dq = self.hand.fingers()
        message = JointState(name=list(FINGERS), position=list(q), velocity=list(dq))
        message.header.stamp = self.stamp()
        self.finger_pub.publish(message)

    def send_state(self):
        if "franka_robot_state_broadcaster" not in self.controllers:
            return
        message = FrankaRobotState(robot_mode=self.mode)
        message.header.stamp = self.stamp()
        for name in self.errors:
            setattr(message.current_errors, name, True)
        f = message.o_f_ext_hat_k.wrench
        tcp = (self.world.T_base_hand() @ np.array([0.0, 0.0, 0.1034, 1.0]))[:3]
        wrench = external_wrench(self.world.client, self.world.robot, tcp) + self.faults.get("wrench", [0.0] * 6)
        f.force.x, f.force.y, f.force.z, f.torque.x, f.torque.y, f.torque.z = map(float, wrench)
        self.state_pub.publish(message)

    # what it serves

    def serve(self, options):
        node = self.node

        def action(kind, name, execute, goal=lambda _: GoalResponse.ACCEPT):
            return ActionServer(
                node, kind, name, execute, goal_callback=goal, cancel_callback=lambda g, n=name: self.cancelled(n)
            )

        self.servers = []
        if not options.no_arm:
            self.servers.append(
                action(
                    FollowJointTrajectory,
                    "/panda_arm_controller/follow_joint_trajectory",
                    self.follow,
                    self.consider,
                )
            )
        node.create_subscription(JointTrajectory, "/panda_arm_controller/joint_trajectory", self.on_topic, 1)
        if not options.no_gripper:
            self.servers += [
                action(Homing, "/franka_gripper/homing", self.homing),
                action(Move, "/franka_gripper/move", self.move),
                action(Grasp, "/franka_gripper/grasp", self.grasp),
                action(GripperCommand, "/franka_gripper/gripper_action", self.gripper_command),
            ]
            node.create_service(Trigger, "/franka_gripper/stop", self.stop)
        self.servers.append(action(ErrorRecovery, "/action_server/error_recovery", self.recover))
        node.create_service(
            SetHardwareComponentState, "/controller_manager/set_hardware_component_state", self.set_hardware
        )
        node.create_service(SwitchController, "/controller_manager/switch_controller", self.switch)

    def tell(self, what, detail=""):
        self.wire.append((time.monotonic(), what, detail))

    def cancelled(self, name):
        self.tell("cancel", name)
        return CancelResponse.ACCEPT

    async def until(self, condition):
        """Let the loop go on until the condition holds."""
        future = Future(executor=self.executor)
        self.pending.append((condition, future))
        await future

    async def consider(self, request):
        self.tell("goal", f"{len(request.trajectory.points)} points")
        if self.faults.get("silent"):
            await self.until(lambda: not self.faults.get("silent"))
        why = refusal(request.trajectory, self.names, self.jtc.joints()[0])
        if "panda_arm_controller" not in self.controllers:
            why = "the controller is not active"
        if self.faults.get("reject"):
            why = "told to reject"
        if why:
            self.tell("reject", why)
        return GoalResponse.REJECT if why else GoalResponse.ACCEPT

    async def follow(self, handle):
        self.tell("start")
        self.jtc.start(handle.request.trajectory)
        last = [0.0]

        def over():
            if handle.is_cancel_requested and self.jtc.busy and not self.faults.get("ignore_cancel"):
                self.jtc.drop("cancelled")
            after = self.faults.get("abort_after")
            if after is not None and self.jtc.busy and self.jtc.elapsed > after:
                self.jtc.drop("path tolerance violated: told to abort")
            if self.jtc.busy and not self.jtc.frozen and time.monotonic() - last[0] > 0.05:
                last[0] = time.monotonic()
                handle.publish_feedback(FollowJointTrajectory.Feedback(joint_names=list(self.names)))
            return not self.jtc.busy

        await self.until(over)
        good, code, why = self.jtc.outcome
        self.tell("end", why or "reached")
        if handle.is_cancel_requested:
            handle.canceled()
        elif good:
            handle.succeed()
        else:
            handle.abort()
        return FollowJointTrajectory.Result(error_code=code, error_string=why)

    def on_topic(self, message):
        why = refusal(message, self.names, self.jtc.joints()[0])
        self.tell("topic", why or f"{len(message.points)} points")
        if not why:
            self.jtc.start(message)

    # recovery in three ordered steps

    async def recover(self, handle):
        self.tell("error_recovery")
        await self.until(lambda: self.mode != 5)
        if self.faults.get("refuse_recovery"):
            handle.abort()
            return ErrorRecovery.Result()
        self.errors, self.mode = (), 1
        handle.succeed()
        return ErrorRecovery.Result()

    def set_hardware(self, request, response):
        self.tell("set_hardware", f"{request.name} {request.target_state.label} {request.target_state.id}")
        response.ok = not self.errors and request.name == "FrankaHardwareInterface" and request.target_state.id == 3
        self.hardware = self.hardware or response.ok
        response.state.label = "active" if self.hardware else "unconfigured"
        return response

    def switch(self, request, response):
        self.tell("switch", " ".join(request.activate_controllers))
        response.ok = self.hardware
        response.message = "" if self.hardware else "hardware is not active"
        if response.ok:
            self.controllers |= set(request.activate_controllers) & set(CONTROLLERS)
            self.mode = 2
        return response

    def run(self, requests):
        due = time.monotonic()
        while rclpy.ok():
            now = time.monotonic()
            due = max(due, now - 0.05)
            for _ in range(12):
                if due > now:
                    break
                self.publish_due()
                self.world.step()
                due += DT / self.speed
            self.publish_due()
            ready = [entry for entry in self.pending if entry[0]()]
            for entry in ready:
                self.pending.remove(entry)
                entry[1].set_result(None)
            for _ in range(3):
                self.executor.spin_once(timeout_sec=0.0)
            if due > time.monotonic():
                self.executor.spin_once(timeout_sec=0.002)
            while not requests.empty():
                connection, request = requests.get()
                try:
                    connection.send((True, self.answer(*request)))
                except Exception as error:
                    connection.send((False, f"{type(error).__name__}: {error}"))


def listen(path, requests):
    with Listener(path, "AF_UNIX") as listener:
        connection = listener.accept()
        while True:
            try:
                requests.put((connection, connection.recv()))
            except EOFError:
                os._exit(0)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--socket", required=True)
    parser.add_argument("--scene", default="packed")
    parser.add_argument("--objects", type=int, default=5)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--rate", type=float, default=50.0)
    parser.add_argument("--no-arm", action="store_true")
    parser.add_argument("--no-gripper", action="store_true")
    options = parser.parse_args()
    peer = Peer(options)
    requests = queue.Queue()
    threading.Thread(target=listen, args=(options.socket, requests), daemon=True).start()
    peer.run(requests)


if __name__ == "__main__":
    np.set_printoptions(precision=4)
    main()
