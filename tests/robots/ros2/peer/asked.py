"""What a test may ask of the peer beside ROS: faults, facts, a new table, the truth."""

from std_msgs.msg import Empty

CONTROLLERS = ("joint_state_broadcaster", "franka_robot_state_broadcaster", "panda_arm_controller")


class Asked:
    """`answer("word", ...)` calls `asked_word(...)`."""

    def answer(self, command, *values):
        return getattr(self, f"asked_{command}")(*values)

    def asked_fault(self, faults):
        self.faults = dict(faults)
        self.jtc.frozen = bool(self.faults.get("freeze"))

    def asked_facts(self):
        q, dq = self.jtc.joints()
        return {"q": q, "dq": dq, "width": self.hand.width(), "wire": list(self.wire), "busy": self.jtc.busy}

    def asked_mode(self, mode):
        self.mode = mode

    def asked_reflex(self):
        """As franka_ros2 does: error, motion aborted, hardware unconfigured, controllers inactive."""
        self.errors, self.mode = ("cartesian_reflex",), 4
        self.jtc.drop("path tolerance violated: reflex")
        self.hardware, self.controllers = False, {"joint_state_broadcaster", "franka_robot_state_broadcaster"}

    def asked_user_stop(self):
        self.mode = 5
        self.jtc.drop("path tolerance violated: user stop")

    def asked_stop_topic(self):
        self.stop_pub.publish(Empty())

    def asked_deactivate(self):
        self.controllers, self.mode = {"joint_state_broadcaster", "franka_robot_state_broadcaster"}, 1

    def asked_home(self):
        """As when it was started: well, open, at the look pose, at rest, and nothing heard."""
        self.asked_fault({})
        self.mode, self.errors, self.hardware, self.controllers = 2, (), True, set(CONTROLLERS)
        robot, client = self.world.robot, self.world.client
        for joint, q in zip(robot.joints, self.world.robot_config.look_q_rad, strict=True):
            client.resetJointState(robot.body, joint, q)
        for finger in robot.fingers:
            client.resetJointState(robot.body, finger, 0.04)
        self.jtc.reset()
        self.hand.reset()
        self.wire.clear()
        self.late.clear()

    def asked_round(self, number, seed):
        self.objects = self.rounds.prepare(number, seed)
        return self.objects

    def asked_truth(self):
        truth = self.world.truth()
        return len(truth.on_table), len(truth.in_bin)

    def asked_frame(self):
        return self.camera.capture(after=0.0, timeout=5.0)

    def asked_camera_pose(self):
        return self.camera.T_base_cam
