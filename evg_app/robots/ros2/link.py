"""One node, one background executor: everything that touches rclpy runs on its thread, everybody else waits here."""

import contextlib
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from evg_app.clock import Clock
from evg_app.errors import DeviceTimeout, HardwareError
from evg_app.robots.ros2.interfaces import rclpy

T = TypeVar("T")
SPIN_S = 0.1
"""How long the executor waits at most before it looks whether it should end [s]."""
WINDOW_S, WINDOW_CALLBACKS = 0.01, 5
"""At most so many callbacks in such a time [s]: topics at 1 kHz would keep a core busy, but only the latest counts."""
CALL_TIMEOUT_S = 5.0
"""How long a call on the executor's thread may take; it only hands things to the middleware [s]."""


class Link:
    """The connection to ROS, shared by the devices of one robot; it lives while at least one of them is entered.

    rclpy is used from one thread only: several of its races (a response before its request is known) cannot happen.
    Ctrl-C stays with the application: rclpy installs no signal handler.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self.clock = clock
        self._name = name
        self._users = 0
        self._thread: threading.Thread | None = None
        self._ending = threading.Event()
        self._failure: BaseException | None = None
        self._context: Any = None
        self._executor: Any = None
        self.node: Any = None

    def acquire(self) -> None:
        """Start the node and its thread, or share those that run.

        Raises:
            MissingExtra: rclpy is not installed.
            HardwareError: the middleware did not start.
        """
        if self._users == 0:
            self._start()
        self._users += 1

    def release(self) -> None:
        """Give it back; the last user ends it."""
        self._users = max(0, self._users - 1)
        if self._users == 0:
            self._stop()

    def _start(self) -> None:
        """Make the node and its thread."""
        module = rclpy()
        from rclpy.executors import SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        self._failure = None
        self._ending.clear()
        self._context = module.Context()
        try:
            module.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
            self.node = module.create_node(
                self._name, context=self._context, start_parameter_services=False, enable_rosout=False
            )
            self._executor = SingleThreadedExecutor(context=self._context)
            self._executor.add_node(self.node)
        except Exception as error:
            self._stop()
            raise HardwareError(f"ROS 2 did not start: {error}. Run: evg-app ros check") from error
        self._thread = threading.Thread(target=self._spin, name="ros2", daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        """The executor's thread: callbacks, at most so many in a time."""
        window, left = self.clock.now() + WINDOW_S, WINDOW_CALLBACKS
        while not self._ending.is_set():
            try:
                self._executor.spin_once(timeout_sec=SPIN_S)
                left -= 1
                if left <= 0:
                    self._ending.wait(max(0.0, window - self.clock.now()))
                if self.clock.now() >= window:
                    window, left = self.clock.now() + WINDOW_S, WINDOW_CALLBACKS
            except Exception as error:
                if not self._ending.is_set():
                    self._failure = error
                return

    def _stop(self) -> None:
        """End the thread and free the node."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join(timeout=CALL_TIMEOUT_S)
            self._thread = None
        with contextlib.suppress(Exception):
            self._executor.shutdown(timeout_sec=0.5)
        with contextlib.suppress(Exception):
            self.node.destroy_node()
        with contextlib.suppress(Exception):
            self._context.try_shutdown()
        self.node = self._executor = self._context = None

    @property
    def alive(self) -> bool:
        """Whether the executor runs."""
        return self._thread is not None and self._failure is None

    def check(self) -> None:
        """Pass while the executor runs.

        Raises:
            HardwareError: it does not; the message says why.
        """
        if self._failure is not None:
            raise HardwareError(f"the ROS 2 thread ended: {self._failure}. Start the run again") from self._failure
        if self._thread is None:
            raise HardwareError("the robot is not connected; enter the arm or the gripper first")

    def call(self, work: Callable[[], T], what: str) -> T:
        """Run `work` on the executor's thread and return what it returns; what it raises is raised here.

        Raises:
            DeviceTimeout: the thread did not come to it in time.
        """
        self.check()
        if threading.current_thread() is self._thread:
            return work()
        done = threading.Event()
        box: list[Any] = []

        def task() -> None:
            """Do the work and keep what came of it."""
            try:
                box.append((work(), None))
            except Exception as error:
                box.append((None, error))
            done.set()

        self._executor.create_task(task)
        self.wait(done, CALL_TIMEOUT_S, what, "The computer is too busy, or the middleware hangs.")
        value, error = box[0]
        if error is not None:
            raise error
        return value  # type: ignore[no-any-return]

    def wait(self, event: threading.Event, timeout: float, what: str, advice: str = "") -> None:
        """Wait at most `timeout` [s] for `event`.

        Raises:
            DeviceTimeout: named `what`.
            HardwareError: the executor ended meanwhile.
        """
        end = self.clock.now() + timeout
        while not event.wait(min(SPIN_S, max(0.0, end - self.clock.now()))):
            self.check()
            if self.clock.now() >= end:
                raise DeviceTimeout(what, timeout, advice)

    def wait_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Look every 10 ms until `condition` holds, at most `timeout` [s]; whether it did.

        Raises:
            HardwareError: the executor ended meanwhile.
        """
        end = self.clock.now() + timeout
        while not condition():
            self.check()
            if self.clock.now() >= end:
                return False
            self.clock.sleep(0.01)
        return True
