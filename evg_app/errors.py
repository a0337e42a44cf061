"""What can go wrong. Every message says what, why, and the next thing to do."""


class EvgError(Exception):
    """Base of every error that evg-app raises on purpose. `exit_code` is the command's exit status."""

    exit_code = 2


class BadInput(EvgError):
    """A name, file or value that the user gave cannot be used (exit 2)."""

    exit_code = 2


class ConfigError(BadInput):
    """A config file is unreadable or breaks its model.

    Attributes:
        path: the file.
        line: 1-based line of the offending key, or None.
    """

    def __init__(self, path: str, line: int | None, problem: str) -> None:
        self.path, self.line = path, line
        super().__init__(f"{path}{f':{line}' if line else ''}: {problem}")


class UnknownName(BadInput):
    """A robot, camera, scene or model of that name does not exist.

    Attributes:
        kind: what was looked up.
        name: the name given.
        known: the names that exist.
    """

    def __init__(self, kind: str, name: str, known: list[str], hint: str = "") -> None:
        self.kind, self.name, self.known = kind, name, known
        listed = ", ".join(sorted(known)) or "none"
        super().__init__(f"unknown {kind} '{name}'; available: {listed}.{' ' + hint if hint else ''}")


class WeightsError(BadInput):
    """A weights file is missing, corrupt, or does not fit the model."""


class MissingExtra(BadInput):
    """An optional dependency is not installed.

    Attributes:
        package: the import that failed.
        extra: the extra of evg-app that brings it.
    """

    def __init__(self, package: str, extra: str) -> None:
        self.package, self.extra = package, extra
        super().__init__(f"'{package}' is not installed. Run: ./setup.sh {extra}")


class Refused(EvgError):
    """evg-app declines to go on: calibration or a software limit (exit 3; not a safety function)."""

    exit_code = 3


class LimitViolation(Refused):
    """A trajectory would break a limit and was not sent.

    Attributes:
        joint: name of the joint.
        quantity: "position", "velocity", "acceleration" or "jerk".
        value: the worst value [rad and s].
        limit: the allowed magnitude [rad and s].
    """

    def __init__(self, joint: str, quantity: str, value: float, limit: float) -> None:
        self.joint, self.quantity, self.value, self.limit = joint, quantity, value, limit
        super().__init__(f"{joint} {quantity} {value:.4g} exceeds the limit {limit:.4g}; nothing was sent")


class HardwareError(EvgError):
    """A device did not do what it was asked (exit 4)."""

    exit_code = 4


class DeviceTimeout(HardwareError):
    """A named wait ran out.

    Attributes:
        wait: name of what was waited for.
        timeout: how long [s].
    """

    def __init__(self, wait: str, timeout: float, advice: str = "") -> None:
        self.wait, self.timeout = wait, timeout
        super().__init__(f"timed out after {timeout:g} s waiting for {wait}.{' ' + advice if advice else ''}")


class Stopped(EvgError):
    """The user asked to stop (exit 130)."""

    exit_code = 130
