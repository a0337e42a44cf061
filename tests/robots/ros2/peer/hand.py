"""A Franka Hand in PyBullet, stepped from outside."""

import pybullet

STALL_S = 0.15


class Hand:
    """One command at a time; `outcome` holds the final width once it ended."""

    def __init__(self, world):
        self.world = world
        self.outcome = None
        self.busy = False
        world.before_step.append(self.act)
        world.on_reset.append(self.reset)
        self._target, self._speed, self._force = world.robot_config.gripper.max_width_m, 0.1, 20.0
        self._still = 0.0
        self.reset()

    def reset(self):
        self.busy = False
        self._drive(self.world.robot_config.gripper.max_width_m, 0.1, 20.0)

    def fingers(self):
        states = self.world.client.getJointStates(self.world.robot.body, self.world.robot.fingers)
        return [s[0] for s in states], [s[1] for s in states]

    def width(self):
        return sum(self.fingers()[0])

    def _drive(self, width, speed, force):
        self._target = width
        for finger in self.world.robot.fingers:
            self.world.client.setJointMotorControl2(
                self.world.robot.body,
                finger,
                pybullet.POSITION_CONTROL,
                targetPosition=width / 2,
                force=force,
                maxVelocity=max(speed, 1e-3) / 2,
                positionGain=0.2,
            )

    def command(self, width, speed, force, fine):
        self.world.solve_finely(fine)
        self._drive(min(max(width, 0.0), 0.08), speed, force)
        self.busy, self.outcome, self._still = True, None, 0.0

    def stop(self):
        self._drive(self.width(), 0.1, 20.0)
        if self.busy:
            self.busy, self.outcome = False, "stopped"

    def act(self):
        if not self.busy:
            return
        self._still = self._still + 1.0 / 240.0 if abs(sum(self.fingers()[1])) < 0.002 else 0.0
        if self._still >= STALL_S:
            self.busy = False
            self.outcome = "arrived" if abs(self.width() - self._target) < 0.001 else "stalled"
