"""Finding a board in a picture: corners to a fraction of a pixel, and pictures that are not worth using."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evg_app.geometry import Array, make, transform_points
from evg_app.handeye.boards import Board, Gray, opencv
from evg_app.handeye.lens import undistort
from evg_app.handeye.tag_corners import refine_tags
from evg_app.types import Intrinsics

MIN_CORNERS = 8
"""Fewer corners of a board are not used."""
MAX_EDGE_WIDTH = 1.8
"""Standard deviation of the widest edges above which a picture is blurred [px]."""
UNFOUND_EDGE_WIDTH = 1.4
"""The same where no board was found: sharp pictures have about 1, and blur is the likeliest cause [px]."""
NO_EDGE = 8.0
"""Wider than this it is no edge but shading [px]."""
MAX_OBLIQUITY = 65.0
"""Angle between the view and the board's normal above which corners are found badly [deg]."""
LEAST_CONTRAST, BOARD_CONTRAST = 25.0, 80.0
"""Grey levels that a patch must span to say something about blur; without corners, to be taken for a board."""
TILE = 48
"""Side of the patches of a picture without corners [px]."""
MAX_FIT = 1.0
"""RMS distance of the corners from a plane board above which something is wrong with the picture [px]."""


@dataclass(frozen=True)
class Detection:
    """What was found in one picture.

    Attributes:
        ids: numbers of the corners. Shape (n,).
        pixels: where they are (column, row), distorted as in the picture. Shape (n, 2).
        ideal: the same without lens distortion. Shape (n, 2).
        T_cam_board: from this picture alone (nominal board size), identity when not found. Shape (4, 4).
        fit: RMS distance of the corners from that pose's projection [px].
        edge_width: of the blurriest direction [px].
        problem: why it must not be used, or an empty string.
    """

    ids: NDArray[np.int64]
    pixels: Array
    ideal: Array
    T_cam_board: Array
    fit: float
    edge_width: float
    problem: str = ""

    @property
    def ok(self) -> bool:
        """Whether the picture can be used."""
        return not self.problem


def detect(board: Board, gray: Gray, intrinsics: Intrinsics) -> Detection:
    """Find the board in an 8-bit picture (H, W)."""
    ids, pixels = _corners(board, gray, intrinsics)
    if len(ids) < MIN_CORNERS:
        width = edge_width(gray, None)
        problem = (
            "blurred" if width > UNFOUND_EDGE_WIDTH else "board not found" if len(ids) == 0 else "board mostly hidden"
        )
        return Detection(ids, pixels, pixels, np.eye(4), 0.0, width, problem)
    ideal = undistort(pixels, intrinsics)
    T, fit = board_pose(board.points[ids], ideal, intrinsics)
    width = edge_width(gray, pixels)
    return Detection(ids, pixels, ideal, T, fit, width, _problem(board, T, fit, width))


def _problem(board: Board, T_cam_board: Array, fit: float, width: float) -> str:
    """Why the picture must not be used, or an empty string."""
    if width > MAX_EDGE_WIDTH:
        return "blurred"
    sight = transform_points(T_cam_board, board.center)
    cosine = abs(float(T_cam_board[:3, 2] @ sight) / float(np.linalg.norm(sight)))
    if np.rad2deg(np.arccos(min(cosine, 1.0))) > MAX_OBLIQUITY:
        return "too oblique"
    if fit > MAX_FIT:
        return "corners off the plane"
    return ""


@lru_cache(maxsize=8)
def _detector(kind: str, pattern: Any) -> Any:
    """OpenCV's detector of one pattern, made once."""
    cv2 = opencv()
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = 3
    parameters.adaptiveThreshWinSizeMax = 43
    if kind == "charuco":
        charuco = cv2.aruco.CharucoParameters()
        return cv2.aruco.CharucoDetector(pattern, charuco, parameters)
    return cv2.aruco.ArucoDetector(pattern.getDictionary(), parameters)


def _corners(board: Board, gray: Gray, intrinsics: Intrinsics) -> tuple[NDArray[np.int64], Array]:
    """Numbers (n,) and pixels (n, 2) of the corners found."""
    find = _chessboard_corners if board.model.kind == "charuco" else _tag_corners
    found = find(board, gray, intrinsics)
    return found if found is not None else (np.zeros(0, np.int64), np.zeros((0, 2)))


def _chessboard_corners(board: Board, gray: Gray, _intrinsics: Intrinsics) -> tuple[NDArray[np.int64], Array] | None:
    """Saddle points between the squares of a ChArUco board; None without any."""
    cv2 = opencv()
    corners, ids, _, _ = _detector(board.model.kind, board.pattern).detectBoard(gray)
    if ids is None:
        return None
    pixels = np.asarray(corners, np.float32).reshape(-1, 1, 2)
    half = int(np.clip(_spacing(pixels[:, 0].astype(np.float64)) * 0.25, 2, 6))
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    pixels = cv2.cornerSubPix(gray, pixels, (half, half), (-1, -1), stop)
    return np.asarray(ids).ravel().astype(np.int64), np.asarray(pixels, dtype=np.float64).reshape(-1, 2)


def _tag_corners(board: Board, gray: Gray, intrinsics: Intrinsics) -> tuple[NDArray[np.int64], Array] | None:
    """Corners of the tags of a grid whose edges are clean; None without any tag."""
    found, ids, _ = _detector(board.model.kind, board.pattern).detectMarkers(gray)
    if ids is None:
        return None
    place = {int(tag): k for k, tag in enumerate(np.ravel(board.pattern.getIds()))}
    pairs = [(place[int(tag)], quad) for tag, quad in zip(np.ravel(ids), found, strict=True) if int(tag) in place]
    if not pairs:
        return None
    quads, clean = refine_tags(gray, np.stack([quad.reshape(4, 2) for _, quad in pairs]), intrinsics)
    numbers = np.stack([np.arange(4 * k, 4 * k + 4, dtype=np.int64) for k, _ in pairs])
    return numbers[clean].ravel(), quads[clean].reshape(-1, 2)


def _spacing(pixels: Array) -> float:
    """Typical distance of neighbouring corners [px]."""
    if len(pixels) < 2:
        return 10.0
    d = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    d[d < 1e-6] = np.inf
    return float(np.median(d.min(axis=1)))


def board_pose(points: Array, ideal: Array, intrinsics: Intrinsics, guess: Array | None = None) -> tuple[Array, float]:
    """T_cam_board (4, 4) from points (n, 3) and undistorted pixels (n, 2), and the RMS residual [px].

    A plane has two poses that look alike; `guess` (4, 4) settles which.
    """
    cv2 = opencv()
    if guess is None:
        solved, rvecs, tvecs, _ = cv2.solvePnPGeneric(points, ideal, intrinsics.K, None, flags=cv2.SOLVEPNP_IPPE)
        starts = list(zip(rvecs, tvecs, strict=True)) if solved else []
    else:
        starts = [(cv2.Rodrigues(guess[:3, :3])[0], guess[:3, 3:].copy())]
    best, least = np.eye(4), float("inf")
    for rvec, tvec in starts:
        rvec, tvec = cv2.solvePnPRefineLM(points, ideal, intrinsics.K, None, rvec.copy(), tvec.copy())
        seen = cv2.projectPoints(points, rvec, tvec, intrinsics.K, None)[0].reshape(-1, 2)
        rms = float(np.sqrt(((seen - ideal) ** 2).sum(axis=1).mean()))
        if rms < least and float(tvec[2, 0]) > 0:
            best, least = make(cv2.Rodrigues(rvec)[0], tvec[:, 0]), rms
    return best, least


def edge_width(gray: Gray, pixels: Array | None) -> float:
    """Standard deviation [px] of the sharpest edges around the corners, of the blurrier direction.

    A step blurred by a Gaussian has its largest slope = contrast / (sigma sqrt(2 pi)).
    """
    if pixels is None or len(pixels) == 0:
        return _width_anywhere(gray)
    half = int(np.clip(_spacing(pixels) * 0.6, 5, 30))
    corners = np.rint(pixels).astype(int)
    patches = [gray[max(v - half, 0) : v + half + 1, max(u - half, 0) : u + half + 1] for u, v in corners]
    widths = [w for w in (_patch_width(p.astype(np.float32), LEAST_CONTRAST) for p in patches) if w is not None]
    return float(np.median(widths)) if widths else 99.0


def _width_anywhere(gray: Gray) -> float:
    """The same for a picture without corners, from its high-contrast patches; 0 when there are none."""
    tiles = [(r, c) for r in range(0, gray.shape[0], TILE) for c in range(0, gray.shape[1], TILE)]
    patches = (gray[r : r + TILE, c : c + TILE].astype(np.float32) for r, c in tiles)
    widths = [w for w in (_patch_width(p, BOARD_CONTRAST) for p in patches) if w is not None and w < NO_EDGE]
    return float(np.percentile(widths, 25)) if widths else 0.0


def _patch_width(patch: NDArray[np.float32], least: float) -> float | None:
    """Edge width of one patch [px], None where it spans less than `least` grey levels."""
    if min(patch.shape) < 8:
        return None
    low, high = np.percentile(patch, (5, 95))
    contrast = float(high - low)
    if contrast < least:
        return None
    smooth = (patch[:-2] + 2 * patch[1:-1] + patch[2:]) / 4
    gx = np.abs(smooth[:, 2:] - smooth[:, :-2]).max() / 2
    smooth = (patch[:, :-2] + 2 * patch[:, 1:-1] + patch[:, 2:]) / 4
    gy = np.abs(smooth[2:] - smooth[:-2]).max() / 2
    return float(contrast / (max(min(gx, gy), 1e-3) * np.sqrt(2 * np.pi)))
