"""Words of the stream: how rounds and passes end, and which stages are timed."""

from enum import StrEnum


class StopReason(StrEnum):
    """Why a round ended."""

    CLEARED = "cleared"
    TWO_FAILURES = "two consecutive failures"
    NO_GRASP = "no grasp"
    NO_FEASIBLE = "no feasible grasp"
    ATTEMPT_LIMIT = "attempt limit"
    STOPPED = "stopped by the user"
    ERROR = "error"


class AttemptOutcome(StrEnum):
    """How a pass through the loop ended. Only `SUCCESS` and `FAILURE` are attempts that count (spec §6.1)."""

    SUCCESS = "success"
    FAILURE = "failure"
    ABANDONED = "abandoned"
    NO_GRASP = "no grasp"
    NO_FEASIBLE = "no feasible grasp"
    EMPTY_VIEW = "empty view"
    REPLANNED = "replanned"
    ERROR = "error"

    @property
    def counts(self) -> bool:
        """Whether a grasp was physically executed and so counts in GSR."""
        return self in (AttemptOutcome.SUCCESS, AttemptOutcome.FAILURE)


class Stage(StrEnum):
    """Timed parts of a pass. `COMPUTE_STAGES` are those between a depth image and a ready trajectory."""

    CAPTURE = "capture"
    FILTER = "filter"
    FUSE = "fuse"
    PLAN = "plan"
    JUDGE = "judge"
    ROUTE = "route"
    RECHECK = "recheck"


COMPUTE_STAGES = (Stage.FILTER, Stage.FUSE, Stage.PLAN, Stage.JUDGE)
"""From the depth image to the ready trajectory; `capture` waits for a device, `route` plans way-back motions."""
