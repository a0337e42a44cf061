"""One unit of work: a scene, the reachability of its grasps, and every pick of every arm of the experiment."""

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from evg_app.benchmark.motion.baseline import straight_pick
from evg_app.benchmark.motion.cell import Cell, Executed, Observation
from evg_app.benchmark.motion.config import MotionBenchmark, kind_of
from evg_app.benchmark.motion.contacts import Contact
from evg_app.benchmark.motion.limits import broken
from evg_app.benchmark.motion.row import BASELINE, OBSERVED, TRUE, Cycle, SceneRow, Target
from evg_app.benchmark.motion.stages import StageTimes, timed_stages
from evg_app.benchmark.motion.targets import Targets, targets_of
from evg_app.config.models import RobotConfig
from evg_app.geometry import Array
from evg_app.motion.exhaustive import reachability
from evg_app.motion.feasibility import MotionPlanner
from evg_app.motion.plan import PickDecision, PickPlan
from evg_app.motion.scene import SceneView
from evg_app.trials.statistics import tally
from evg_app.types import Verdict

POLICIES: tuple[str, ...] = get_args(RobotConfig.model_fields["unknown_space"].annotation)
"""What may be thought of space that no camera saw."""
LABELS = 1
"""Stream of random numbers for the labels of a scene."""


class Planners:
    """One motion planner for each policy; loading takes seconds, so a process does it once."""

    def __init__(self, config: MotionBenchmark) -> None:
        """Load the models.

        Raises:
            BadInput: the robot's configuration cannot be used.
        """
        robot = config.robot_config()
        self.configured = robot.unknown_space
        self.by_policy = {p: MotionPlanner(robot.model_copy(update={"unknown_space": p})) for p in POLICIES}

    @property
    def default(self) -> MotionPlanner:
        """The one with the configured policy."""
        return self.by_policy[self.configured]


def run_scene(config: MotionBenchmark, planners: Planners, seed: int, number: int, git_commit: str = "") -> SceneRow:
    """Scene `number` of `seed`: a function of these and of the config (times apart).

    Raises:
        EvgError: no scene came out of the recipe.
    """
    with Cell(config, seed, number) as cell:
        state, q = cell.state(), cell.q()
        targets = targets_of(state, config.candidates, np.random.default_rng([seed, number, LABELS]))
        true, observed = cell.true_view(), cell.observe(planners.default.kinematics)
        reach = reachable(planners.default, targets, targets.spread(config.reach), true, q, config.seeds)
        times = timed_stages(planners.default, targets, targets.spread(config.reach), observed.view, q)
        cycles = _Cycles(config, planners, cell, targets)
        for owner in range(len(state.objects)):
            cycles.pick(owner, true, observed, q)
    return _row(seed, number, tuple(o.name for o in state.objects), targets, reach, cycles.done, times, git_commit)


def _row(
    seed: int,
    number: int,
    objects: tuple[str, ...],
    targets: Targets,
    reach: tuple[Target, ...],
    cycles: Sequence[Cycle],
    times: StageTimes,
    git_commit: str,
) -> SceneRow:
    """Everything about a scene as one row."""
    return SceneRow(
        seed=seed,
        number=number,
        kind=kind_of(number),
        objects=objects,
        grasps=len(targets),
        targets=reach,
        cycles=tuple(cycles),
        scene_ms=tuple(times.scene_ms),
        check_ms=tuple(times.check_ms),
        legs_ms=tuple(times.legs_ms),
        path_ms=tuple(times.path_ms),
        timing_ms=tuple(times.timing_ms),
        git_commit=git_commit,
    )


def reachable(
    planner: MotionPlanner, targets: Targets, chosen: NDArray[np.int64], view: SceneView, q: Array, seeds: int
) -> tuple[Target, ...]:
    """Whether the exhaustive search and the planner find a way to each of the chosen targets."""
    scene, T_base_task = planner.prepared(view, q), planner.robot.T_base_task.matrix()
    found = []
    for index in chosen:
        T = T_base_task @ targets.T_task_grasp[index]
        complete = reachability(planner, scene, T, q, seeds)
        decision = planner.plan_pick(targets.take(np.array([index])), view, q)
        found.append(
            Target(
                owner=int(targets.owner[index]),
                configuration=complete.configuration,
                legs=complete.legs,
                found=complete.found_legs,
                picked=decision.pick is not None,
                verdict=str(decision.verdicts[0]),
            )
        )
    return tuple(found)


class _Cycles:
    """Plans and executes the picks of one scene."""

    def __init__(self, config: MotionBenchmark, planners: Planners, cell: Cell, targets: Targets) -> None:
        """For the picks of one scene."""
        self._config, self._planners, self._cell, self._targets = config, planners, cell, targets
        self.done: list[Cycle] = []

    def pick(self, owner: int, true: SceneView, observed: Observation, q: Array) -> None:
        """Every arm of the experiment picks one object, each from the same state; nothing without a grasp for it."""
        grasps = self._targets.of(owner, self._config.examined)
        if len(grasps) == 0:
            return
        default = self._planners.default
        decision = default.plan_pick(grasps, true, q, max_examined=len(grasps))
        self._execute(TRUE, owner, decision)
        if decision.pick is not None:
            straight = straight_pick(default.kinematics, decision.pick.T_base_grasp, q)
            if straight is not None:
                self.done.append(_cycle(BASELINE, owner, self._cell.execute(straight, owner)))
        before: tuple[PickPlan, Cycle] | None = None
        for policy, planner in self._planners.by_policy.items():
            decision = planner.plan_pick(grasps, observed.view, q, max_examined=len(grasps))
            arm = f"{OBSERVED} {policy}"
            if before is not None and decision.pick is not None and _equal(before[0], decision.pick):
                self.done.append(replace(before[1], arm=arm, still=None, moved=None))
                continue
            self._execute(arm, owner, decision, observed)
            before = None if decision.pick is None else (decision.pick, self.done[-1])

    def _execute(self, arm: str, owner: int, decision: PickDecision, seen: Observation | None = None) -> None:
        """Execute a decision, or note why there is none."""
        if decision.pick is None:
            looked = tally(str(v) for v in decision.verdicts if v is not Verdict.NOT_EXAMINED)
            reasons = ", ".join(f"{name} {n}" for name, n in looked.items())
            self.done.append(Cycle(arm, owner, f"no pick: {reasons}"))
            return
        self.done.append(_cycle(arm, owner, self._cell.execute(decision.pick, owner, seen)))


def _equal(a: PickPlan, b: PickPlan) -> bool:
    """Whether two picks send the same samples: then physics does the same again."""
    names = ("reach", "approach", "lift", "transport", "retreat", "back")
    return all(np.array_equal(getattr(a, name).q, getattr(b, name).q) for name in names)


def _cycle(arm: str, owner: int, what: Executed) -> Cycle:
    """What was executed, as values of a row."""
    return Cycle(
        arm=arm,
        owner=owner,
        ended=what.ended,
        contacts=tuple(_words(c) for c in what.before),
        after=tuple(_words(c) for c in what.after),
        target_before=what.target_before,
        held=what.held,
        delivered=what.delivered,
        ratios={name: round(ratio, 6) for name, ratio in what.ratios.items()},
        broken=broken(what.ratios),
        seconds=round(what.seconds, 3),
        still=what.still,
        moved=what.moved,
    )


def _words(contact: Contact) -> str:
    """A contact as text."""
    return f"{contact.phase}: {contact.link} - {contact.other} ({contact.depth * 1e3:.2f} mm)"
