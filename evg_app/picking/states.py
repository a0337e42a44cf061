"""The loop as data: states, what each may end with, and where that leads."""

from enum import StrEnum

from evg_app.events import StopReason


class State(StrEnum):
    """What the loop is doing."""

    LOOK = "look"
    OBSERVE = "observe"
    PLAN = "plan"
    FILTER = "filter"
    CONFIRM = "confirm"
    REACH = "reach"
    RECHECK = "recheck"
    APPROACH = "approach"
    CLOSE = "close"
    LIFT = "lift"
    VERIFY = "verify"
    DROP = "drop"
    RELEASE = "release"
    RETURN = "return"
    RETREAT = "retreat"
    RECOVER = "recover"
    SCORE = "score"


class Outcome(StrEnum):
    """How a state ended. `FAULT` and `STOP` are given by the driver, the others by the state's handler."""

    OK = "ok"
    NOTHING = "nothing"
    BLOCKED = "blocked"
    EMPTY = "empty"
    HOLDING = "holding"
    CLEARED = "cleared"
    TWO_FAILURES = "two failures"
    SPENT = "spent"
    CHANGED = "changed"
    ASK = "ask"
    REJECTED = "rejected"
    GIVE_UP = "give up"
    FAULT = "fault"
    STOP = "stop"


START = State.LOOK
"""Where every round begins."""

TRANSITIONS: dict[State, dict[Outcome, State | StopReason]] = {
    State.LOOK: {
        Outcome.OK: State.OBSERVE,
        Outcome.BLOCKED: State.RECOVER,
        Outcome.FAULT: State.RECOVER,
        Outcome.STOP: StopReason.STOPPED,
    },
    State.OBSERVE: {
        Outcome.OK: State.PLAN,
        Outcome.CLEARED: StopReason.CLEARED,
        Outcome.EMPTY: StopReason.NO_GRASP,
        Outcome.FAULT: StopReason.ERROR,
        Outcome.STOP: StopReason.STOPPED,
    },
    State.PLAN: {
        Outcome.OK: State.FILTER,
        Outcome.NOTHING: StopReason.NO_GRASP,
        Outcome.FAULT: StopReason.ERROR,
        Outcome.STOP: StopReason.STOPPED,
    },
    State.FILTER: {
        Outcome.OK: State.REACH,
        Outcome.ASK: State.CONFIRM,
        Outcome.NOTHING: StopReason.NO_FEASIBLE,
        Outcome.FAULT: StopReason.ERROR,
        Outcome.STOP: StopReason.STOPPED,
    },
    State.CONFIRM: {
        Outcome.OK: State.REACH,
        Outcome.REJECTED: State.FILTER,
        Outcome.FAULT: StopReason.ERROR,
        Outcome.STOP: StopReason.STOPPED,
    },
    State.REACH: {
        Outcome.OK: State.RECHECK,
        Outcome.BLOCKED: State.RETREAT,
        Outcome.FAULT: State.RECOVER,
        Outcome.STOP: State.RETREAT,
    },
    State.RECHECK: {
        Outcome.OK: State.APPROACH,
        Outcome.CHANGED: State.RETREAT,
        Outcome.FAULT: State.RECOVER,
        Outcome.STOP: State.RETREAT,
    },
    State.APPROACH: {
        Outcome.OK: State.CLOSE,
        Outcome.BLOCKED: State.RETREAT,
        Outcome.FAULT: State.RECOVER,
        Outcome.STOP: State.RETREAT,
    },
    State.CLOSE: {Outcome.OK: State.LIFT, Outcome.FAULT: State.RECOVER},
    State.LIFT: {Outcome.OK: State.VERIFY, Outcome.BLOCKED: State.VERIFY, Outcome.FAULT: State.RECOVER},
    State.VERIFY: {Outcome.HOLDING: State.DROP, Outcome.EMPTY: State.RETREAT, Outcome.FAULT: State.RECOVER},
    State.DROP: {Outcome.OK: State.RELEASE, Outcome.BLOCKED: State.RECOVER, Outcome.FAULT: State.RECOVER},
    State.RELEASE: {Outcome.OK: State.RETURN, Outcome.FAULT: State.RECOVER},
    State.RETURN: {Outcome.OK: State.SCORE, Outcome.BLOCKED: State.RECOVER, Outcome.FAULT: State.RECOVER},
    State.RETREAT: {Outcome.OK: State.SCORE, Outcome.BLOCKED: State.RECOVER, Outcome.FAULT: State.RECOVER},
    State.RECOVER: {
        Outcome.OK: State.RETREAT,
        Outcome.HOLDING: State.DROP,
        Outcome.GIVE_UP: StopReason.ERROR,
        Outcome.FAULT: StopReason.ERROR,
    },
    State.SCORE: {
        Outcome.OK: State.LOOK,
        Outcome.CLEARED: StopReason.CLEARED,
        Outcome.TWO_FAILURES: StopReason.TWO_FAILURES,
        Outcome.SPENT: StopReason.ATTEMPT_LIMIT,
        Outcome.FAULT: StopReason.ERROR,
        Outcome.STOP: StopReason.STOPPED,
    },
}
"""Every state and every outcome it may end with. A `StopReason` ends the round."""
