"""One round: look, plan, grasp, until the table is clear, the planner gives up or two grasps in a row fail."""

import time
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any, Protocol, Self

import numpy as np

from evg_app.benchmark.clutter.config import BenchmarkConfig
from evg_app.benchmark.clutter.table import ClutteredTable
from evg_app.benchmark.clutter.view import Observation, observe
from evg_app.errors import BadInput
from evg_app.geometry import Array
from evg_app.grasping.protocol import Planner
from evg_app.grasping.turned import plan_turned
from evg_app.simulation.free_gripper import GraspOutcome
from evg_app.types import Grasps

MAX_FAILURES = 2
"""So many failures in a row end a round."""
SCENE, VIEW, NOISE, POLICY = range(4)
"""Streams of random numbers; each has its own seed in every round, so that none depends on another's use."""


class End(StrEnum):
    """Why a round ended."""

    CLEARED = "cleared"
    EMPTY_VIEW = "empty view"
    NO_GRASP = "no grasp"
    FAILURES = "consecutive failures"


@dataclass(frozen=True)
class RoundResult:
    """What happened in one round.

    Attributes:
        seed, round: which.
        objects: on the table after the scene was built: the denominator of DR.
        successes, attempts: grasps that held, and grasps that were executed.
        cleared: objects taken away by successful grasps.
        end: why it ended.
        outcomes: for each attempt "success", "touched" (something on the approach, and not held) or "missed".
        plan_ms: wall time of every plan, those without a grasp included [ms].
        names: the objects, in order of placement.
        git_commit: of the code that ran it.
    """

    seed: int
    round: int
    objects: int
    successes: int
    attempts: int
    cleared: int
    end: str
    outcomes: tuple[str, ...] = ()
    plan_ms: tuple[float, ...] = ()
    names: tuple[str, ...] = ()
    git_commit: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The opposite of `to_dict`.

        Raises:
            BadInput: the values are not a round.
        """
        try:
            lists = {k: tuple(values[k]) for k in ("outcomes", "plan_ms", "names")}
            return cls(**(values | lists))
        except (TypeError, KeyError) as error:
            raise BadInput(f"not a round of a benchmark: {error}; delete the file, or name another") from error


class Table(Protocol):
    """What a round needs of the world."""

    @property
    def objects(self) -> int:
        """How many objects are left."""

    def execute(self, T_task_grasp: Array) -> GraspOutcome:
        """Try a grasp (4, 4) and take away what it held."""


class Looker(Protocol):
    """Sees and plans: an observation's grasps at attempt k, None when the view is empty."""

    def __call__(self, attempt: int) -> Grasps | None:
        """Grasps, best first."""


@dataclass
class Tally:
    """Accounts of a round under way (spec §6.1).

    Attributes:
        outcomes: as in `RoundResult`.
        cleared: as in `RoundResult`.
        failures: in a row, up to now.
    """

    outcomes: list[str] = field(default_factory=list)
    cleared: int = 0
    failures: int = 0

    @property
    def successes(self) -> int:
        """Grasps that held."""
        return self.outcomes.count("success")

    def add(self, outcome: GraspOutcome) -> None:
        """Count one executed grasp."""
        self.outcomes.append("success" if outcome.success else "touched" if outcome.touched else "missed")
        self.cleared += outcome.held is not None
        self.failures = 0 if outcome.success else self.failures + 1


def play(table: Table, look: Looker) -> tuple[Tally, End]:
    """Look, plan and grasp until the round ends. Only executed grasps are attempts."""
    tally = Tally()
    while table.objects:
        if tally.failures == MAX_FAILURES:
            return tally, End.FAILURES
        grasps = look(len(tally.outcomes))
        if grasps is None:
            return tally, End.EMPTY_VIEW
        if len(grasps) == 0:
            return tally, End.NO_GRASP
        tally.add(table.execute(grasps.T_task_grasp[0]))
    return tally, End.CLEARED


class _Eyes:
    """Looks at a table and plans, with its own streams of view, noise and policy."""

    def __init__(self, config: BenchmarkConfig, table: ClutteredTable, planner: Planner, key: tuple[int, int]) -> None:
        self._config, self._table, self._planner, self._key = config, table, planner, key
        self.plan_ms: list[float] = []

    def __call__(self, attempt: int) -> Grasps | None:
        seen = self.observation(attempt)
        if seen.empty:
            return None
        policy = int(self._stream(POLICY, attempt).integers(2**31))
        start = time.perf_counter()
        grasps = plan_turned(self._planner, seen.values, seen.T_task_cam, policy)
        self.plan_ms.append(round(1000.0 * (time.perf_counter() - start), 2))
        return grasps

    def observation(self, attempt: int) -> Observation:
        """The noisy view before attempt k."""
        view, noise = self._stream(VIEW, attempt), self._stream(NOISE, attempt)
        return observe(self._config, self._table.state(), view, noise)

    def _stream(self, which: int, attempt: int) -> np.random.Generator:
        return np.random.default_rng([*self._key, which, attempt])


def run_round(config: BenchmarkConfig, planner: Planner, seed: int, number: int, git_commit: str = "") -> RoundResult:
    """Play round `number` of `seed`: a function of these and of the config (times apart)."""
    scene_rng = np.random.default_rng([seed, number, SCENE])
    with ClutteredTable(config, config.object_models(), scene_rng) as table:
        names = tuple(thing.model.name for thing in table.placed)
        eyes = _Eyes(config, table, planner, (seed, number))
        tally, end = play(table, eyes)
    return RoundResult(
        seed=seed,
        round=number,
        objects=len(names),
        successes=tally.successes,
        attempts=len(tally.outcomes),
        cleared=tally.cleared,
        end=end.value,
        outcomes=tuple(tally.outcomes),
        plan_ms=tuple(eyes.plan_ms),
        names=names,
        git_commit=git_commit,
    )
