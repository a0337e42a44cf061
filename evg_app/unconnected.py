"""Devices that exist in this process only."""

from types import TracebackType
from typing import Self


class Unconnected:
    """A device with nothing to open and nothing to close, as the context manager that every device is."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None
