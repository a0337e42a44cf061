"""One simulated session: collected by one process, solved by another that never sees the truth, then judged."""

from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, Literal, Self

import numpy as np

from evg_app.config.calibration import MODES, Mode
from evg_app.config.files import load_camera, load_robot
from evg_app.handeye.boards import load_board
from evg_app.handeye.collect import collect, visit
from evg_app.handeye.poses import Reach
from evg_app.handeye.result import as_facts
from evg_app.handeye.sample import Session, views_of
from evg_app.handeye.solve import solve
from evg_app.handeye.standin.bench import one_axis_stops, simulated_bench
from evg_app.handeye.standin.devices import Faults
from evg_app.handeye.standin.judge import judged, true_errors
from evg_app.handeye.standin.world import draw_truth
from evg_app.handeye.starts import SOLVERS, plain
from evg_app.motion.feasibility import MotionPlanner

Kind = Literal["good", "one-axis", "board-scale", "swapped-mode", "moved", "outliers", "blur", "lens"]
BAD: tuple[Kind, ...] = ("one-axis", "board-scale", "swapped-mode", "moved", "outliers", "blur", "lens")
ROBOT, CAMERA = "panda", "d435i"
TOO_LARGE = 1.03
"""How much too large the board of a "board-scale" session is printed."""
FEW = 3
"""Samples of the quick practice: the fewest that OpenCV takes (other tools accept two)."""
WRONG = 5
"""Samples with wrong joint positions in an "outliers" session."""
GOOD_MM = 3.0
"""True error up to which a session counts as repaired [mm]."""


@dataclass(frozen=True)
class Study:
    """What all sessions of a study share."""

    board: str = "charuco_a4"
    samples: int = 24


@dataclass(frozen=True)
class SessionRow:
    """One session, judged.

    Attributes:
        kind, mode, seed: which session.
        facts: what the tool said, with `true_mm` and `true_deg` by the judge.
        plain_mm: true error of each plain OpenCV solver and of Tsai's on three samples [mm], None where it failed.
        plain_deg: the same in degrees.
    """

    kind: Kind
    mode: Mode
    seed: int
    facts: dict[str, Any]
    plain_mm: dict[str, float | None]
    plain_deg: dict[str, float | None]

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Self:
        """The opposite of `to_dict`."""
        return cls(**values)

    @property
    def named(self) -> bool:
        """Whether the cause was named."""
        return self.kind in self.facts["causes"]

    @property
    def harmless(self) -> bool:
        """Whether the session was refused, or its result is good all the same."""
        true_mm = self.facts["true_mm"]
        return self.facts["verdict"] == "refuse" or (true_mm is not None and true_mm <= GOOD_MM)


@lru_cache(maxsize=1)
def motion() -> MotionPlanner:
    """The arm's motion, loaded once per process."""
    return MotionPlanner(load_robot(ROBOT))


def faults_of(kind: Kind, mode: Mode, seed: int, samples: int) -> Faults:
    """What is wrong with a session, random within its kind."""
    rng = np.random.default_rng([seed, MODES.index(mode), 31])
    if kind == "board-scale":
        return Faults(print_scale=TOO_LARGE)
    if kind == "blur":
        return Faults(blur_px=float(rng.uniform(7, 14)))
    if kind == "outliers":
        wrong = rng.choice(np.arange(6, samples), WRONG, replace=False)
        return Faults(wrong_joints=tuple(sorted(int(k) for k in wrong)))
    if kind == "moved":
        shift, turn = rng.normal(size=3), rng.normal(size=3)
        shift *= rng.uniform(0.005, 0.03) / np.linalg.norm(shift)
        turn *= np.deg2rad(rng.uniform(0.3, 3.0)) / np.linalg.norm(turn)
        return Faults(bump=tuple(float(v) for v in (*shift, *turn)), bump_at=samples // 2)
    if kind == "lens":
        off = rng.uniform((0.008, 4.0, 4.0), (0.015, 8.0, 8.0)) * rng.choice((-1.0, 1.0), 3)
        return Faults(lens=tuple(float(v) for v in off))
    return Faults()


def collected(study: Study, kind: Kind, mode: Mode, seed: int) -> Session:
    """Take the samples of one session. Holds pictures' detections and joints, no truth."""
    camera, board = load_camera(CAMERA), load_board(study.board)
    faults = faults_of(kind, mode, seed, study.samples)
    lab = simulated_bench(motion(), motion().robot, camera, board, mode, seed, lambda sample, frame: None, faults)
    if kind == "one-axis":
        session = visit(lab.bench, one_axis_stops(lab, study.samples, seed))
    else:
        session = collect(lab.bench, study.samples, seed)
    if kind == "swapped-mode":
        session = replace(session, mode=MODES[1 - MODES.index(mode)])
    return session.with_samples([replace(sample, gray=None) for sample in session.samples])


def solved(session: Session) -> tuple[dict[str, Any], dict[str, Any]]:
    """The tool's facts, and the transform of each plain solver and of three-sample practice (None where it fails)."""
    facts = as_facts(session, solve(session))
    views = views_of(session, session.usable())
    transforms: dict[str, Any] = {}
    for name in SOLVERS:
        found = plain(views, name) if len(views) > 2 else None
        transforms[name] = None if found is None else found[0].tolist()
    few = np.sort(np.random.default_rng(len(views)).permutation(len(views))[:FEW])
    found = plain(views.take(few), "tsai") if len(few) == FEW else None
    transforms["three samples (tsai)"] = None if found is None else found[0].tolist()
    return facts, transforms


def judge(
    study: Study, kind: Kind, mode: Mode, seed: int, outcome: tuple[dict[str, Any], dict[str, Any]]
) -> SessionRow:
    """Compare with the truth."""
    facts, transforms = outcome
    nominal = load_camera(CAMERA).simulated_intrinsics()
    truth = draw_truth(mode, seed, Reach(motion()), load_board(study.board), nominal)
    errors = {
        name: (None, None) if T is None else true_errors(truth, motion().kinematics, np.array(T))
        for name, T in transforms.items()
    }
    row = judged(facts, truth, motion().kinematics)
    row.pop("T_parent_cam", None), row.pop("T_other_board", None)
    return SessionRow(kind, mode, seed, row, {n: e[0] for n, e in errors.items()}, {n: e[1] for n, e in errors.items()})
