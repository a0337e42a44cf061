"""Calibration boards: ChArUco and AprilTag grids, their YAML in `calibration/boards/`, and how they look.

The board frame lies in the printed plane: origin at its upper left corner, x right, y down, z into the board.
"""

import hashlib
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from evg_app.config.calibration import FOLDER
from evg_app.config.files import read, search_path
from evg_app.config.models import Model
from evg_app.errors import MissingExtra, UnknownName
from evg_app.geometry import Array

Gray = NDArray[np.uint8]
Metres = Annotated[float, Field(gt=0.002, lt=1.0)]

DICTIONARIES = {"charuco": "DICT_4X4_50", "apriltag-grid": "DICT_APRILTAG_36h11"}


def opencv() -> Any:
    """OpenCV, with every hand-eye solver.

    Raises:
        MissingExtra: it is not installed, or is 5.x, which lost them.
    """
    try:
        import cv2
    except ImportError as error:
        raise MissingExtra("opencv-python-headless<5", "") from error
    if not hasattr(cv2, "calibrateHandEye") or not hasattr(cv2, "aruco"):
        raise MissingExtra("opencv-python-headless<5", "")
    return cv2


class BoardModel(Model):
    """One board (`calibration/boards/<name>.yaml`).

    Attributes:
        columns, rows: squares of a ChArUco board, tags of a grid.
        square_m: side of a square, or of a tag.
        marker_m: side of a ChArUco marker; gap between the tags of a grid.
    """

    name: str
    kind: Literal["charuco", "apriltag-grid"]
    columns: int = Field(ge=2, le=20)
    rows: int = Field(ge=2, le=20)
    square_m: Metres
    marker_m: Metres

    @model_validator(mode="after")
    def _fits(self) -> Self:
        """Markers must fit into squares, and the dictionary must have enough of them."""
        if self.kind == "charuco" and self.marker_m >= self.square_m:
            raise ValueError(f"marker_m {self.marker_m} must be smaller than square_m {self.square_m}")
        if self.kind == "charuco" and self.columns * self.rows > 100:
            raise ValueError("DICT_4X4_50 has markers for at most 100 squares")
        if self.kind == "apriltag-grid" and self.columns * self.rows > 500:
            raise ValueError("the 36h11 family has fewer tags")
        return self

    @property
    def sha256(self) -> str:
        """Identifies the geometry."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:16]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the pattern [m]."""
        if self.kind == "charuco":
            return self.columns * self.square_m, self.rows * self.square_m
        pitch = self.square_m + self.marker_m
        return self.columns * pitch - self.marker_m, self.rows * pitch - self.marker_m


class Board:
    """A board's points and picture."""

    def __init__(self, model: BoardModel) -> None:
        """Build it.

        Raises:
            MissingExtra: OpenCV is missing.
        """
        self.model = model

    def __getstate__(self) -> dict[str, BoardModel]:
        """OpenCV's objects stay behind when a board goes to another process."""
        return {"model": self.model}

    @cached_property
    def pattern(self) -> Any:
        """OpenCV's board."""
        cv2, m = opencv(), self.model
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARIES[m.kind]))
        if m.kind == "charuco":
            return cv2.aruco.CharucoBoard((m.columns, m.rows), m.square_m, m.marker_m, dictionary)
        return cv2.aruco.GridBoard((m.columns, m.rows), m.square_m, m.marker_m, dictionary)

    @cached_property
    def points(self) -> Array:
        """Every corner that detection can find, by its number, in the board frame [m]. Shape (C, 3)."""
        charuco = self.model.kind == "charuco"
        corners = self.pattern.getChessboardCorners() if charuco else self.pattern.getObjPoints()
        points: Array = np.array(corners, dtype=np.float64).reshape(-1, 3)
        return points

    @property
    def outline(self) -> Array:
        """The four corners of the pattern [m]. Shape (4, 3)."""
        w, h = self.model.size
        return np.array([[0, 0, 0], [w, 0, 0], [w, h, 0], [0, h, 0]], dtype=np.float64)

    @property
    def center(self) -> Array:
        """Middle of the pattern [m]. Shape (3,)."""
        center: Array = self.outline.mean(axis=0)
        return center

    def picture(self, pixels_per_m: float) -> Gray:
        """The pattern without a border, white 255. Shape (H, W)."""
        w, h = (round(side * pixels_per_m) for side in self.model.size)
        picture: Gray = np.array(self.pattern.generateImage((w, h), marginSize=0, borderBits=1), dtype=np.uint8)
        return picture


def known_boards(config_dir: Path | None = None) -> dict[str, Path]:
    """Names and files of the boards in the search path."""
    found: dict[str, Path] = {}
    for folder in search_path(config_dir):
        for path in sorted((folder / FOLDER / "boards").glob("*.yaml")):
            found.setdefault(path.stem, path)
    return found


def load_board(name: str, config_dir: Path | None = None) -> Board:
    """The board of that name.

    Raises:
        UnknownName: there is none.
        ConfigError: its file is broken.
    """
    known = known_boards(config_dir)
    if name not in known:
        raise UnknownName("board", name, list(known), "Make one: evg-app calibrate board --help")
    return Board(read(known[name], BoardModel))
