"""Finished units on disk: one JSON line each beside the result, so that an interrupted benchmark goes on."""

import fcntl
import json
import logging
from pathlib import Path
from typing import IO, Any, Generic, Protocol, Self, TypeVar

from evg_app.errors import BadInput

log = logging.getLogger(__name__)


class Row(Protocol):
    """The result of one unit of work."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The opposite of `to_dict`."""


R = TypeVar("R", bound=Row)


class Journal(Generic[R]):
    """The lines of one benchmark. The first line says what was measured; a broken last line is left out.

    One process at a time: two would do the same units and count them twice.
    """

    def __init__(self, path: Path, header: dict[str, Any], row: type[R]) -> None:
        """Open the file, or begin it with `header` (its "digest" tells benchmarks apart).

        Raises:
            BadInput: the file holds units of another benchmark, another process writes it, or it cannot be read or
                written.
        """
        self.path = path
        self._lock = self._locked()
        self.rows: list[R] = []
        lines = self._lines()
        if not lines:
            self._write(json.dumps(header) + "\n", "w")
            return
        if lines[0].get("digest") != header["digest"]:
            raise BadInput(
                f"{path} holds results of other settings, weights or objects; name another --json, or delete that file"
            )
        self.rows = [row.from_dict(line) for line in lines[1:]]

    def close(self) -> None:
        """Let others write it; also done when the process ends."""
        self._lock.close()

    def _locked(self) -> IO[bytes]:
        """The file, held against other processes while it is open."""
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            file = self.path.open("ab")
        except OSError as error:
            raise BadInput(f"{self.path} cannot be written ({error}); name another --json") from error
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            file.close()
            raise BadInput(
                f"another process writes {self.path}; wait for it, stop it, or name another --json"
            ) from error
        return file

    def append(self, row: R) -> None:
        """Add one finished unit.

        Raises:
            BadInput: the file cannot be written.
        """
        self.rows.append(row)
        self._write(json.dumps(row.to_dict()) + "\n", "a")

    def _lines(self) -> list[dict[str, Any]]:
        """The readable lines; what an interruption left half-written at the end is cut off."""
        try:
            text = self.path.read_text(encoding="utf-8") if self.path.exists() else ""
        except (OSError, UnicodeDecodeError) as error:
            raise BadInput(f"{self.path} cannot be read ({error}); delete it, or name another --json") from error
        found: list[dict[str, Any]] = []
        whole = 0
        for line in text.splitlines(keepends=True):
            try:
                if not line.endswith("\n"):
                    raise ValueError("the line has no end")
                found.append(json.loads(line))
            except ValueError as error:
                log.warning("%s: a broken line (%s); it and what follows is left out", self.path, error)
                self._write(text[:whole], "w")
                break
            whole += len(line)
        return found

    def _write(self, text: str, mode: str) -> None:
        """Write or append text."""
        try:
            with self.path.open(mode, encoding="utf-8") as file:
                file.write(text)
        except OSError as error:
            raise BadInput(f"{self.path} cannot be written: {error.strerror}. Name a --json you may write") from error
