"""OpenCV's hand-eye solvers: starts of the refinement, and what plain practice would have given."""

from collections.abc import Iterator

import numpy as np

from evg_app.geometry import Array, invert, is_transform, make
from evg_app.handeye.boards import opencv
from evg_app.handeye.refine import Fit, fit_at
from evg_app.handeye.rigid import mean_transform
from evg_app.handeye.sample import Views

HAND_EYE = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
ROBOT_WORLD = ("SHAH", "LI")
SOLVERS = tuple(name.lower() for name in HAND_EYE) + tuple(f"robot-world-{name.lower()}" for name in ROBOT_WORLD)
SUBSETS, SUBSET_SIZE = 60, 5
"""Random subsets that are solved, so that outlying samples spoil only some of the starts."""


def plain(views: Views, name: str) -> tuple[Array, Array] | None:
    """X and Z of one of OpenCV's solvers (`SOLVERS`), or None when it fails or returns no transform."""
    cv2 = opencv()
    A_inverse, B = invert(views.A), views.B
    try:
        if name.startswith("robot-world-"):
            method = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name.rsplit('-', 1)[1].upper()}")
            # base2gripper (A) and world2cam (B): B = X^-1 A Z, so gripper2cam is X^-1 and base2world is Z^-1.
            R_base, t_base, R_grip, t_grip = cv2.calibrateRobotWorldHandEye(
                list(B[:, :3, :3]), list(B[:, :3, 3]), list(views.A[:, :3, :3]), list(views.A[:, :3, 3]), method=method
            )
            Z, X = invert(make(R_base, t_base.ravel())), invert(make(R_grip, t_grip.ravel()))
        else:
            method = getattr(cv2, f"CALIB_HAND_EYE_{name.upper()}")
            R, t = cv2.calibrateHandEye(
                list(A_inverse[:, :3, :3]), list(A_inverse[:, :3, 3]), list(B[:, :3, :3]), list(B[:, :3, 3]),
                method=method,
            )  # fmt: skip
            X = make(R, t.ravel())
            Z = mean_transform(A_inverse @ X @ B)
    except (cv2.error, ValueError, np.linalg.LinAlgError):
        return None
    if not (np.isfinite(X).all() and np.isfinite(Z).all()):
        return None
    return (X, Z) if is_transform(X, 1e-3) and is_transform(Z, 1e-3) else None


def starts(views: Views, rng: np.random.Generator) -> Iterator[Fit]:
    """Starts from every solver on all samples, and from Park's and Shah's on random subsets."""
    for name in SOLVERS:
        found = plain(views, name)
        if found is not None:
            yield fit_at(views, *found)
    if len(views) <= SUBSET_SIZE:
        return
    for k in range(SUBSETS):
        part = views.take(np.sort(rng.choice(len(views), SUBSET_SIZE, replace=False)))
        found = plain(part, ("park", "robot-world-shah")[k % 2])
        if found is not None:
            yield fit_at(views, *found)


def best_starts(views: Views, count: int = 4, seed: int = 0) -> list[Fit]:
    """The most promising starts by the median error of the samples, best first; may be empty."""
    found = list(starts(views, np.random.default_rng(seed)))
    found.sort(key=lambda fit: float(np.median(fit.sample_rms(views))))
    return found[:count]
