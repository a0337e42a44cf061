"""What a person who watches the loop was asked, and said."""

from dataclasses import dataclass


@dataclass(frozen=True, eq=False)
class GraspOffered:
    """A person is asked about a planned grasp; nothing moves until there is an answer.

    Attributes:
        index: of the candidate.
        score: its score.
        width: its opening [m].
        duration: of the motions from here to above the bin [s].
    """

    index: int
    score: float
    width: float
    duration: float


@dataclass(frozen=True)
class Answer:
    """What the person said about a grasp; `reason` says why not."""

    accepted: bool
    reason: str = ""


@dataclass(frozen=True, eq=False)
class GraspAnswered:
    """The answer about candidate `index`, after `seconds` [s] of wall time."""

    index: int
    answer: Answer
    seconds: float


@dataclass(frozen=True, eq=False)
class Held:
    """A person held the loop before `state` for `seconds` [s] of wall time."""

    state: str
    seconds: float
