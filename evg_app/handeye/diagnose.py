"""What is wrong with a session, in words: each finding names its cause and what to do about it."""

from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from evg_app.config.calibration import Mode
from evg_app.geometry import Array, invert
from evg_app.handeye.change import Step
from evg_app.handeye.rigid import log
from evg_app.handeye.sample import Session, Views

Severity = Literal["note", "warn", "refuse"]

MIN_SAMPLES = 8
"""Fewer usable samples are not solved."""
MANY_REJECTED = 0.3
"""Share of rejected pictures that is worth a warning."""
MIN_SPREAD = 6.0
"""Least root-mean-square turn about the second rotation axis [deg]."""
SCALE_LEAST, SCALE_SIGMAS = 0.006, 4.0
"""A board is of the wrong size from this relative deviation, and this many standard deviations, on."""
LENS_FOCAL, LENS_CENTRE_PX = 0.005, 4.0
"""Focal length (relative) and principal point [px] are wrong from this far off the stream's on."""
DISAGREE_MM = 15.0
"""Median distance of the closed-form solvers from the refined result that is worth a warning [mm]."""
DEPTH_SHARE = 0.05
"""Relative disagreement of the depth camera with the board that is worth a warning."""


@dataclass(frozen=True)
class Finding:
    """One thing that was noticed.

    Attributes:
        cause: a fixed word: "one-axis", "board-scale", "lens", "swapped-mode", "moved", "outliers", "blur", "hidden",
            "few-samples", "no-solution", "solvers-disagree", "depth", "table", "heldout" or "bound".
        severity: what it does to the verdict.
        text: for the user.
    """

    cause: str
    severity: Severity
    text: str


def pictures(session: Session) -> list[Finding]:
    """Rejected pictures, and whether enough are left."""
    findings: list[Finding] = []
    total, usable = len(session.samples), len(session.usable())
    why = Counter(s.detection.problem for s in session.samples if not s.detection.ok)
    short = usable < MIN_SAMPLES
    blurred = why.pop("blurred", 0)
    if blurred and (short or blurred > MANY_REJECTED * total):
        width = float(np.median([s.detection.edge_width for s in session.samples if s.detection.problem == "blurred"]))
        findings.append(
            Finding(
                "blur",
                "refuse" if short else "warn",
                f"{blurred} of {total} pictures are blurred (edges {width:.1f} px wide): focus the lens, add light or "
                "shorten the exposure, and let the arm come to rest",
            )
        )
    others = sum(why.values())
    if others and (short or others > MANY_REJECTED * total):
        listed = ", ".join(f"{text} {count}" for text, count in why.most_common())
        findings.append(
            Finding(
                "hidden",
                "refuse" if short else "warn",
                f"{others} of {total} pictures could not be used ({listed}): keep the whole board in view and facing "
                "the camera, and check that --board names the printed board",
            )
        )
    if short:
        findings.append(
            Finding("few-samples", "refuse", f"{usable} usable samples, at least {MIN_SAMPLES} are needed: take more")
        )
    return findings


def rotations(views: Views, mode: Mode) -> list[Finding]:
    """Whether the arm turned about more than one axis."""
    hands = views.A if mode == "eye-to-hand" else invert(views.A)
    mean = Rotation.from_matrix(hands[:, :3, :3]).mean().as_matrix()
    turns = np.rad2deg(log(mean.T @ hands[:, :3, :3]))
    values, axes = np.linalg.eigh(turns.T @ turns / len(turns))
    spread = np.sqrt(np.maximum(values[::-1], 0.0))
    if spread[1] >= MIN_SPREAD:
        return []
    axis = axes[:, 2]
    names = ("x", "y", "z")
    main = int(np.argmax(np.abs(axis)))
    others = " and ".join(name for k, name in enumerate(names) if k != main)
    if spread[0] < MIN_SPREAD:
        text = (
            f"the hand hardly turns ({spread[0]:.1f} deg RMS): add poses that tilt by 15 to 30 degrees about x, y and z"
        )
    else:
        text = (
            f"all rotations are about one axis (the hand's {names[main]}: {spread[0]:.0f} deg RMS, next "
            f"{spread[1]:.1f} deg): the camera's place along it cannot be known; add poses that tilt about {others}"
        )
    return [Finding("one-axis", "refuse", text)]


def board_size(scale: float, scale_std: float, square_m: float) -> list[Finding]:
    """Whether the robot's motion contradicts the size of the board."""
    off = scale - 1.0
    if abs(off) < max(SCALE_LEAST, SCALE_SIGMAS * scale_std):
        return []
    larger = "larger" if off > 0 else "smaller"
    return [
        Finding(
            "board-scale",
            "warn",
            f"the board is {100 * abs(off):.1f} % (+- {196 * scale_std:.1f}) {larger} than its YAML says (measured by "
            "the arm's motion; corrected here): measure the printed ruler and set the square to "
            f"{1000 * square_m * scale:.2f} mm "
            "(if the print is right, the focal length is not)",
        )
    ]


def lens(off: Array) -> list[Finding]:
    """Whether the stream's intrinsics are wrong. `off`: log focal length and principal point, found minus told (3,)."""
    if abs(off[0]) < LENS_FOCAL and np.abs(off[1:]).max() < LENS_CENTRE_PX:
        return []
    focal, centre = f"{100 * np.expm1(off[0]):+.1f} %", f"({off[1]:+.1f}, {off[2]:+.1f}) px"
    text = (
        f"the focal length is {focal} and the principal point {centre} "
        "off what the camera says (measured by the arm's motion; corrected here, but its depth is not): are the "
        "intrinsics of this resolution, and is the focus fixed?"
    )
    return [Finding("lens", "warn", text)]


def outliers(numbers: "list[int]", rms: "list[float]", total: int, median: float) -> list[Finding]:
    """Samples that were left out because they contradict the others."""
    if not numbers:
        return []
    listed = ", ".join(f"{n} ({r:.1f} px)" for n, r in zip(numbers, rms, strict=True))
    text = (
        f"{len(numbers)} of {total} samples are outliers and were left out: {listed}; the others have {median:.2f} px: "
        "was the arm still moving, or the board touched?"
    )
    return [Finding("outliers", "warn", text)]


def moved(step: Step | None, numbers: NDArray[np.int64], mode: Mode) -> list[Finding]:
    """Whether camera or board moved once. `numbers`: of all usable samples."""
    if step is None or not step.certain:
        return []
    before = int(numbers[numbers < step.first].max(initial=-1))
    words = {
        ("camera", "eye-to-hand"): "the camera (or its stand)",
        ("camera", "eye-in-hand"): "the camera on the hand",
        ("board", "eye-to-hand"): "the board in the hand",
        ("board", "eye-in-hand"): "the board (or what it lies on)",
    }
    what, size = words[step.part, mode], f"by about {1000 * step.size:.1f} mm"
    text = f"{what} moved between samples {before} and {step.first} ({size}): fix it firmly and calibrate again"
    return [Finding("moved", "refuse", text)]


def solver_spread(distances_mm: "dict[str, float | None]") -> list[Finding]:
    """Whether the closed-form solvers are far from the refined result."""
    known = [d for d in distances_mm.values() if d is not None]
    if not known or np.median(known) <= DISAGREE_MM:
        return []
    text = (
        f"the closed-form solvers disagree (median {np.median(known):.0f} mm from the result): the samples "
        "are noisy or too much alike"
    )
    return [Finding("solvers-disagree", "warn", text)]


def depth_check(factor: float) -> list[Finding]:
    """Whether the depth camera sees the board at the distance its corners say. `factor`: corners' over depth's."""
    if abs(1 / factor - 1) < DEPTH_SHARE:
        return []
    off = 100 * (1 / factor - 1)
    text = f"depth reads {off:+.1f} % against the board's distance: check the depth scale and the board's size"
    return [Finding("depth", "warn", text)]
