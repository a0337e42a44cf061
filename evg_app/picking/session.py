"""The little that changes while a round runs, and the one way it speaks to the listeners."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from uuid import uuid4

import numpy as np

from evg_app.errors import EvgError
from evg_app.events import AttemptStarted, Event, Evidence, Sink, Stage, StageTimed
from evg_app.geometry import Array
from evg_app.picking.context import Context, Decision, View
from evg_app.picking.states import State
from evg_app.picking.stop import StopToken
from evg_app.robots.protocol import MotionHandle
from evg_app.types import Frame, Grasps


class Emitter:
    """Feeds the sink. A listener that fails (disk full) ends the run safely instead of leaving the arm mid-air.

    Attributes:
        failure: what the sink raised, or None.
    """

    def __init__(self, sink: Sink, stop: StopToken) -> None:
        self._sink, self._stop = sink, stop
        self.failure: Exception | None = None

    def emit(self, event: Event) -> None:
        """Pass one event on; nothing is sent after a failure."""
        if self.failure is not None:
            return
        with self._stop.shielded():
            try:
                self._sink(event)
            except (OSError, EvgError) as error:
                self.failure = error
                self._stop.request_soft()


@dataclass
class Attempt:
    """One pass through the loop.

    Attributes:
        stage: the last motion state that was entered; says where the arm is.
        began: the arm was sent towards a grasp, so this counts as an attempt.
        closed: the gripper was told to close.
        released: it was told to open over the bin.
        blocked: why a motion did not get where it should, empty when all did.
        fault: what a device reported, empty when nothing.
        further: clean frames of the views before the look pose, with the arm's position [rad] at each.
        recoveries: how often the arm was brought back during this pass.
        changed: the scene changed between planning and approach, so the pass ended without a grasp.
        rejected: candidates that a person rejected.
        judged, judged_why: the judgement from all signs, once made, and why it is no.
    """

    attempt_id: str
    index: int
    planner_seed: int
    stage: State = State.LOOK
    began: bool = False
    closed: bool = False
    released: bool = False
    blocked: str = ""
    fault: str = ""
    recoveries: int = 0
    changed: bool = False
    rejected: set[int] = field(default_factory=set)
    judged: bool | None = None
    judged_why: str = ""
    empty: bool = False
    held_lifted: bool | None = None
    held_release: bool | None = None
    evidence: Evidence = field(default_factory=Evidence)
    frame: Frame | None = None
    further: list[tuple[Frame, Array]] = field(default_factory=list)
    q: Array | None = None
    view: View | None = None
    grasps: Grasps = field(default_factory=Grasps.empty)
    decision: Decision | None = None
    motion_s: float = 0.0
    compute_ms: float = 0.0

    @property
    def verified(self) -> bool | None:
        """The judgement from all signs; before it is made, held after the lift and still held above the bin."""
        if self.judged is not None:
            return self.judged
        return None if self.held_lifted is None else bool(self.held_lifted and self.held_release)

    def note(self, **facts: float | int | bool | None) -> None:
        """Add evidence."""
        self.evidence = replace(self.evidence, **facts)  # type: ignore[arg-type]


@dataclass
class Round:
    """One round under way.

    Attributes:
        passes: passes through the loop so far.
        attempts, successes: of them, those that count.
        failures: in a row.
        recoveries: in a row, without a clean pass between.
        active: the motion under way, or None.
        last_frame: number and stamp of the last frame that was used.
        detail: more about an error.
    """

    ctx: Context
    emitter: Emitter
    seed: int
    index: int
    objects: int | None
    passes: int = 0
    attempts: int = 0
    successes: int = 0
    failures: int = 0
    recoveries: int = 0
    attempt: Attempt | None = None
    active: MotionHandle | None = None
    last_frame: tuple[int, float] | None = None
    detail: str = ""

    def emit(self, event: Event) -> None:
        """Tell the listeners."""
        self.emitter.emit(event)

    def start_attempt(self) -> None:
        """Begin a pass, unless one is under way."""
        if self.attempt is not None:
            return
        seed = int(np.random.SeedSequence([self.seed, self.index, self.passes]).generate_state(1)[0])
        name = f"s{self.seed}-r{self.index:03d}-a{self.passes:02d}-{uuid4().hex[:8]}"
        self.attempt = Attempt(name, self.passes, seed)
        self.emit(AttemptStarted(name, self.seed, self.index, self.passes, seed))
        self.passes += 1

    @property
    def now(self) -> Attempt:
        """The pass under way."""
        if self.attempt is None:
            raise RuntimeError("no attempt is under way")
        return self.attempt

    @contextmanager
    def timed(self, stage: Stage, counts: bool = True) -> Iterator[None]:
        """Time a stage of computing [wall]; `counts` adds it to the pass's compute time."""
        start = self.ctx.stopwatch()
        yield
        wall_ms = (self.ctx.stopwatch() - start) * 1e3
        if counts and self.attempt is not None:
            self.attempt.compute_ms += wall_ms
        self.emit(StageTimed(stage, wall_ms))
