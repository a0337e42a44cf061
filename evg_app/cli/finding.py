"""What `evg-app doctor` finds."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes:
        check: what was looked at.
        status: "ok", "note" (optional thing absent) or "fault" (evg-app cannot run).
        detail: what was found.
        mend: the command or step that mends it, empty when nothing is to be done.
    """

    check: str
    status: str
    detail: str
    mend: str = ""
