"""One goal of one action: sent, accepted, fed back, ended or cancelled, told by events."""

import threading
from typing import Any

from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.robots.ros2.link import Link

SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
"""Of action_msgs/GoalStatus."""
REJECTED = -1
"""evg-app's own: the server did not take the goal."""


class Goal:
    """A goal on its way. Nothing here blocks except `send` and `cancel`, and those have timeouts.

    Attributes:
        status: of action_msgs/GoalStatus once `ended` is set, or `REJECTED`.
        result: the result message once ended, or None.
        heard: when the server last said something about this goal [s].
    """

    def __init__(self, link: Link, client: Any, action: str) -> None:
        self._link, self._client, self._action = link, client, action
        self._answered = threading.Event()
        self._cancel_answered = threading.Event()
        self.ended = threading.Event()
        self._handle: Any = None
        self._unwanted = self._mute = False
        self._problem = ""
        self.status = 0
        self.result: Any = None
        self.feedback: Any = None
        self.heard = 0.0

    def send(self, message: Any, timeout: float, advice: str) -> None:
        """Send it and wait until the server has taken it.

        Raises:
            HardwareError: there is no server, or it rejected the goal.
            DeviceTimeout: the server did not answer in `timeout` [s]; the goal is cancelled should it answer later.
        """
        if not self._client.server_is_ready():
            raise HardwareError(f"nobody serves {self._action}. {advice}")
        try:
            self._link.call(lambda: self._send(message), f"the goal to leave for {self._action}")
            self._link.wait(self._answered, timeout, f"{self._action} to accept the goal", advice)
        except BaseException:
            self._unwanted = True
            self._link_cancel()
            raise
        if self.status == REJECTED:
            raise HardwareError(f"{self._action} rejected the goal{self._problem}. Run: ros2 topic echo /rosout")

    def _send(self, message: Any) -> None:
        """On the executor's thread: send it."""
        future = self._client.send_goal_async(message, feedback_callback=self._on_feedback)
        future.add_done_callback(self._on_answer)

    def _on_feedback(self, message: Any) -> None:
        """The server works on it."""
        self.feedback, self.heard = message.feedback, self._link.clock.now()

    def _on_answer(self, future: Any) -> None:
        """The server took it, or did not."""
        self.heard = self._link.clock.now()
        try:
            self._handle = future.result()
        except Exception as error:
            self._problem, self._handle = f": {error}", None
        if self._handle is None or not self._handle.accepted:
            self.status = REJECTED
            self.ended.set()
        else:
            self._handle.get_result_async().add_done_callback(self._on_result)
            if self._unwanted:
                self._send_cancel()
        self._answered.set()

    def _on_result(self, future: Any) -> None:
        """The server is done with it."""
        self.heard = self._link.clock.now()
        try:
            answer = future.result()
            self.status, self.result = answer.status, answer.result
        except Exception as error:
            self.status, self._problem = ABORTED, str(error)
        self.ended.set()

    def _send_cancel(self) -> None:
        """On the executor's thread: ask for its end."""
        if self._handle is not None and self._handle.accepted:
            self._handle.cancel_goal_async().add_done_callback(lambda _: self._cancel_answered.set())

    def _link_cancel(self) -> None:
        """Ask for the cancel on the executor's thread; a dead link has nobody to ask."""
        if self._link.alive:
            self._link.call(self._send_cancel, f"the cancel to leave for {self._action}")

    def cancel(self, timeout: float) -> bool:
        """Ask the server to stop this goal; whether it answered within `timeout` [s].

        Safe to repeat; a server that once did not answer is asked again, but not waited for.
        """
        if self.ended.is_set():
            return True
        self._unwanted = True
        try:
            self._link_cancel()
            if self._handle is not None and not self._mute:
                self._link.wait(self._cancel_answered, timeout, f"{self._action} to confirm the cancel")
        except DeviceTimeout:
            self._mute = True
        return self.ended.is_set() or not self._mute
