"""What can go wrong with a trial log."""

from evg_app.errors import EvgError


class LogError(EvgError):
    """The trial log cannot be written (disk full, gone, read-only). Exit 4: the arm was brought to rest first.

    Attributes:
        folder: the run folder.
    """

    exit_code = 4

    def __init__(self, folder: str, problem: str) -> None:
        self.folder = folder
        super().__init__(
            f"cannot write the trial log in {folder}: {problem}. "
            "Free space there or make it writable, then go on with --run-dir and --resume"
        )
