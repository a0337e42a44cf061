"""The one append-only stream that the loop writes and that the trial log and every view read."""

from collections.abc import Callable

from evg_app.events.course import (
    AttemptFinished,
    AttemptStarted,
    DepthChecked,
    DevicesConnected,
    RoundFinished,
    RoundStarted,
    RunFinished,
    RunStarted,
    StageTimed,
    StateEntered,
    Warned,
)
from evg_app.events.motion import (
    Evidence,
    GripperMoved,
    MotionEnded,
    MotionStarted,
    Routed,
    Verified,
)
from evg_app.events.outcomes import (
    COMPUTE_STAGES,
    AttemptOutcome,
    Stage,
    StopReason,
)
from evg_app.events.planning import (
    FrameTaken,
    Fused,
    GraspsPlanned,
    Judged,
    SceneRechecked,
    ViewTaken,
)
from evg_app.events.supervision import Answer, GraspAnswered, GraspOffered, Held

__all__ = [
    "COMPUTE_STAGES",
    "Answer",
    "AttemptFinished",
    "AttemptOutcome",
    "AttemptStarted",
    "DepthChecked",
    "DevicesConnected",
    "Event",
    "Evidence",
    "FrameTaken",
    "Fused",
    "GraspAnswered",
    "GraspOffered",
    "GraspsPlanned",
    "GripperMoved",
    "Held",
    "Judged",
    "MotionEnded",
    "MotionStarted",
    "RoundFinished",
    "RoundStarted",
    "Routed",
    "RunFinished",
    "RunStarted",
    "SceneRechecked",
    "Sink",
    "Stage",
    "StageTimed",
    "StateEntered",
    "StopReason",
    "Verified",
    "ViewTaken",
    "Warned",
    "fan_out",
]

Event = (
    RunStarted
    | RoundStarted
    | AttemptStarted
    | StateEntered
    | StageTimed
    | FrameTaken
    | ViewTaken
    | Fused
    | GraspsPlanned
    | Judged
    | SceneRechecked
    | GraspOffered
    | GraspAnswered
    | Held
    | Routed
    | MotionStarted
    | MotionEnded
    | GripperMoved
    | Verified
    | AttemptFinished
    | RoundFinished
    | RunFinished
    | DevicesConnected
    | DepthChecked
    | Warned
)
"""Everything the loop says."""

Sink = Callable[[Event], None]
"""Whoever listens."""


def fan_out(*sinks: Sink) -> Sink:
    """One sink that feeds several, in order; the first error is raised after all were fed."""

    def feed(event: Event) -> None:
        """Feed all of them."""
        failures: list[Exception] = []
        for sink in sinks:
            try:
                sink(event)
            except Exception as error:
                failures.append(error)
        if failures:
            raise failures[0]

    return feed
