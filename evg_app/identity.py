"""What a device says of itself, for the log."""

from collections.abc import Mapping
from typing import Protocol, runtime_checkable


@runtime_checkable
class Identified(Protocol):
    """A device that can say what it is."""

    @property
    def identity(self) -> Mapping[str, str]:
        """Driver, versions, serial numbers, by name; valid once the device was entered."""


def identity_of(device: object) -> dict[str, str]:
    """What a device says of itself; at least its class."""
    told = device.identity if isinstance(device, Identified) else {"driver": type(device).__name__}
    return {name: value for name, value in told.items() if value}


def installed(package: str) -> str:
    """Version of an installed package, empty when it is not."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return ""
