"""What the loop needs of an arm and a gripper."""

from types import TracebackType
from typing import Protocol, Self

from evg_app.types import ArmState, GripperResult, GripperState, MotionResult, Trajectory


class MotionHandle(Protocol):
    """A motion under way."""

    def wait(self, timeout: float) -> MotionResult | None:
        """Wait at most `timeout` [s]; the result once the motion has ended, None while it still moves."""

    def cancel(self) -> None:
        """Stop this motion as fast as the device's limits allow; safe to call at any time, repeatedly."""


class Arm(Protocol):
    """A joint-space arm; a context manager whose exit may be called twice and after a failed entry."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the J joints, in the order of every array."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def state(self) -> ArmState:
        """The latest stamped state.

        Raises:
            DeviceTimeout: the state is stale.
        """

    def execute(self, trajectory: Trajectory) -> MotionHandle:
        """Start a trajectory that begins at the current position.

        Raises:
            Refused: it does not start where the arm is.
            HardwareError: the device rejected it.
        """

    def recover(self, timeout: float) -> None:
        """Clear a reflex or error and wait until the arm is idle.

        Raises:
            DeviceTimeout: it is not idle after `timeout` [s].
        """


class Gripper(Protocol):
    """A parallel gripper; a context manager whose exit may be called twice and after a failed entry."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def state(self) -> GripperState:
        """The latest stamped state."""

    def homing(self, timeout: float) -> GripperResult:
        """Find the opening limits."""

    def move(self, width: float, speed: float, timeout: float) -> GripperResult:
        """Open or close to `width` [m] at `speed` [m/s]."""

    def grasp(
        self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float, timeout: float
    ) -> GripperResult:
        """Close with `force` [N]; success iff width - epsilon_inner < final width < width + epsilon_outer [m]."""

    def stop(self) -> None:
        """Stop moving and keep the fingers where they are."""
