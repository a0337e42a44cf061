"""The peer's gripper: franka_gripper's actions, and GripperCommand beside them."""

from control_msgs.action import GripperCommand
from franka_msgs.action import Grasp, Homing, Move


class Fingers:
    """Action servers around a `Hand`; `until` lets the peer's loop go on, `tell` notes what came over the wire."""

    async def fingers(self, handle, kind, width, speed, force, fine):
        self.tell(kind.__name__.lower(), f"{width:.4f} {force:.1f}")
        if self.faults.get("silent_gripper"):
            await self.until(lambda: not self.faults.get("silent_gripper") or handle.is_cancel_requested)
        self.hand.command(width, speed, force, fine)
        await self.until(lambda: not self.hand.busy or handle.is_cancel_requested)
        if handle.is_cancel_requested:
            self.hand.stop()
            handle.canceled()
            return False
        return True

    async def homing(self, handle):
        if await self.fingers(handle, Homing, 0.08, 0.1, 20.0, False):
            handle.succeed()
        return Homing.Result(success=True)

    async def move(self, handle):
        request = handle.request
        if await self.fingers(handle, Move, request.width, request.speed, 20.0, False):
            handle.succeed()
        good = abs(self.hand.width() - request.width) < 0.002
        return Move.Result(success=good, error="" if good else "in the way")

    async def grasp(self, handle):
        request = handle.request
        if not await self.fingers(handle, Grasp, 0.0, request.speed, request.force, True):
            return Grasp.Result(success=False, error="cancelled")
        final = self.hand.width()
        good = request.width - request.epsilon.inner < final < request.width + request.epsilon.outer
        if self.faults.get("lying_gripper"):
            good = not good
        if good:
            handle.succeed()
        else:
            handle.abort()
        return Grasp.Result(success=good, error="" if good else "not in the window")

    async def gripper_command(self, handle):
        command = handle.request.command
        closing = command.max_effort > 0
        if await self.fingers(handle, GripperCommand, 2 * command.position, 0.1, command.max_effort or 20.0, closing):
            handle.succeed()
        final = self.hand.width() / 2
        arrived = abs(final - command.position) < 0.001
        return GripperCommand.Result(position=final, stalled=not arrived, reached_goal=arrived)

    def stop(self, _request, response):
        self.tell("gripper stop")
        self.hand.stop()
        response.success = True
        return response
