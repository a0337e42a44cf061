"""Pictures of a board by casting rays at its plane: lens distortion, blur, exposure, hiding, sensor noise."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from evg_app.config.calibration import project
from evg_app.geometry import Array, transform_points
from evg_app.handeye.boards import Board, Gray, opencv
from evg_app.handeye.lens import undistort
from evg_app.types import Intrinsics

SUPERSAMPLING = 3
"""Rays per pixel along each axis."""
TEXELS_PER_M = 4000.0
"""Resolution of the printed pattern."""
PAPER_BORDER = 0.012
"""White margin of the plate around the pattern [m]."""
FARTHEST = 2.0
"""Range of the depth [m]."""
INK, PAPER = 0.06, 0.85
"""Reflectance."""

Image = NDArray[np.float32]


@dataclass(frozen=True)
class Exposure:
    """How one picture is taken.

    Attributes:
        gain: exposure; 1 makes paper 0.85 of white.
        slope: light falls off across the plate, relative, along a direction (2,).
        defocus: standard deviation of the lens blur [px].
        motion: blur by motion during the exposure, (column, row) [px].
        hidden: discs in front of the board: (column, row, radius) [px].
        seed: of the sensor noise and the background.
    """

    gain: float = 1.0
    slope: tuple[float, float] = (0.0, 0.0)
    defocus: float = 0.5
    motion: tuple[float, float] = (0.0, 0.0)
    hidden: tuple[tuple[float, float, float], ...] = ()
    seed: int = 0


class BoardPainter:
    """Renders one board through one lens."""

    def __init__(self, board: Board, intrinsics: Intrinsics, print_scale: float = 1.0) -> None:
        """`print_scale`: true over nominal size of the print."""
        self.board, self.intrinsics, self.print_scale = board, intrinsics, print_scale

    @cached_property
    def _texture(self) -> Image:
        """Reflectance of the plate, paper border included."""
        pattern = self.board.picture(TEXELS_PER_M).astype(np.float32) / 255.0
        border = round(PAPER_BORDER * TEXELS_PER_M)
        plate = np.pad(pattern, border, constant_values=1.0)
        return np.asarray(INK + (PAPER - INK) * plate, dtype=np.float32)

    @cached_property
    def _rays(self) -> NDArray[np.float32]:
        """Undistorted ray (x, y) at depth 1 of every pixel centre. Shape (H, W, 2)."""
        K = self.intrinsics
        v, u = np.mgrid[: K.height, : K.width]
        ideal = undistort(np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64), K)
        rays = (ideal - [K.cx, K.cy]) / [K.fx, K.fy]
        return np.asarray(rays.reshape(K.height, K.width, 2), dtype=np.float32)

    def _fine_rays(self, top: int, bottom: int, left: int, right: int) -> tuple[Image, Image]:
        """Rays of the sub-pixels of a crop; the lens is linear within a pixel."""
        cv2, s = opencv(), SUPERSAMPLING
        height, width = bottom - top, right - left
        at = (np.arange(max(height, width) * s, dtype=np.float32) + 0.5) / s - 0.5
        columns, rows = np.meshgrid(at[: width * s] + left, at[: height * s] + top)
        x, y = (
            cv2.remap(np.ascontiguousarray(self._rays[..., k]), columns, rows, cv2.INTER_LINEAR, borderMode=1)
            for k in range(2)
        )
        return x, y

    def corner_pixels(self, T_cam_board: Array) -> Array:
        """Where the plate's corners are (column, row), distorted. Shape (4, 2)."""
        p = transform_points(T_cam_board, self._plate_corners())
        return project(self.intrinsics, p)

    def _plate_corners(self) -> Array:
        """Corners of the plate, its paper border included [m]. Shape (4, 3)."""
        sign = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        return np.asarray((self.board.outline + PAPER_BORDER * sign) * self.print_scale)

    def paint(self, T_cam_board: Array, exposure: Exposure) -> Gray:
        """One 8-bit picture (H, W)."""
        K, rng = self.intrinsics, np.random.default_rng(exposure.seed)
        light = _background(rng, K.height, K.width)
        crop = self._crop(T_cam_board, exposure)
        if crop is not None:
            top, bottom, left, right = crop
            light[top:bottom, left:right] = self._plate(light[top:bottom, left:right], T_cam_board, exposure, crop)
        mean = 255.0 * exposure.gain * light
        noisy = mean + rng.standard_normal(mean.shape, dtype=np.float32) * np.sqrt(2.0 + 0.02 * mean)
        return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8)

    def _crop(self, T_cam_board: Array, exposure: Exposure) -> tuple[int, int, int, int] | None:
        """Rows and columns (top, bottom, left, right) that the plate can touch, or None."""
        if (transform_points(T_cam_board, self._plate_corners())[:, 2] < 0.05).any():
            return None
        K, pixels = self.intrinsics, self.corner_pixels(T_cam_board)
        margin = 4 + int(3 * exposure.defocus + np.hypot(*exposure.motion))
        low, high = np.floor(pixels.min(axis=0)) - margin, np.ceil(pixels.max(axis=0)) + margin
        left, right = int(np.clip(low[0], 0, K.width)), int(np.clip(high[0], 0, K.width))
        top, bottom = int(np.clip(low[1], 0, K.height)), int(np.clip(high[1], 0, K.height))
        return (top, bottom, left, right) if bottom - top > 4 and right - left > 4 else None

    def _plate(self, behind: Image, T_cam_board: Array, exposure: Exposure, crop: tuple[int, int, int, int]) -> Image:
        """The crop with the plate in front of what is behind it."""
        cv2, s = opencv(), SUPERSAMPLING
        x, y = self._fine_rays(*crop)
        (u, v), inside = self._texels(x, y, T_cam_board)
        texture = self._texture
        shade = cv2.remap(texture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        across, down = u / texture.shape[1] - 0.5, v / texture.shape[0] - 0.5
        shade = shade * (1.0 + exposure.slope[0] * across + exposure.slope[1] * down)
        around = cv2.resize(behind, (x.shape[1], x.shape[0]), interpolation=cv2.INTER_LINEAR)
        fine = np.where(inside, shade, around).astype(np.float32)
        rows, columns = np.ogrid[: x.shape[0], : x.shape[1]]
        for column, row, radius in exposure.hidden:
            far = np.hypot(columns / s + crop[2] - column, rows / s + crop[0] - row)
            fine[far < radius] = 0.22
        fine = _blurred(fine, exposure, s)
        return np.asarray(cv2.resize(fine, (x.shape[1] // s, x.shape[0] // s), interpolation=cv2.INTER_AREA))

    def _texels(self, x: Image, y: Image, T: Array) -> tuple[tuple[Image, Image], NDArray[np.bool_]]:
        """Texture coordinates where rays hit the plate's plane, and whether they hit the plate."""
        n, right, down = (T[:3, k].astype(np.float32) for k in (2, 0, 1))
        slant = x * n[0] + y * n[1] + n[2]
        depth = np.float32(T[:3, 2] @ T[:3, 3]) / np.where(np.abs(slant) < 1e-6, np.float32(1e-6), slant)
        scale = np.float32(TEXELS_PER_M / self.print_scale)
        along = [
            (depth * (x * axis[0] + y * axis[1] + axis[2]) - np.float32(axis @ T[:3, 3])) * scale
            for axis in (right, down)
        ]
        border = PAPER_BORDER * TEXELS_PER_M
        u, v = along[0] + np.float32(border - 0.5), along[1] + np.float32(border - 0.5)
        height, width = self._texture.shape
        inside = (depth > 0) & (u >= -0.5) & (v >= -0.5) & (u <= width - 0.5) & (v <= height - 0.5)
        return (u.astype(np.float32), v.astype(np.float32)), inside

    def depth(
        self,
        T_cam_board: Array,
        T_cam_table: Array,
        factor: float,
        noise: float,
        unit: float,
        rng: np.random.Generator,
    ) -> NDArray[np.uint16]:
        """Depth of plate and table (the plane z = 0 of its frame) times `factor`, with `noise` [m]. Shape (H, W)."""
        table = _plane_depth(self._rays, T_cam_table)
        table = np.where((table > 0.1) & (table < FARTHEST), table, 0.0)
        image = _measured(table, factor, noise, unit, rng)
        crop = self._crop(T_cam_board, Exposure())
        if crop is None:
            return image
        top, bottom, left, right = crop
        rays = self._rays[top:bottom, left:right]
        z = _plane_depth(rays, T_cam_board)
        _, inside = self._texels(rays[..., 0], rays[..., 1], T_cam_board)
        plate = _measured(z, factor, noise, unit, rng)
        image[top:bottom, left:right] = np.where(inside, plate, image[top:bottom, left:right])
        return image


def _plane_depth(rays: Image, T: Array) -> Image:
    """Depth at which rays (..., 2) meet the plane z = 0 of a frame at T (4, 4)."""
    n = T[:3, 2].astype(np.float32)
    slant = rays[..., 0] * n[0] + rays[..., 1] * n[1] + n[2]
    return np.asarray(np.float32(T[:3, 2] @ T[:3, 3]) / np.where(np.abs(slant) < 1e-6, np.float32(1e-6), slant))


def _measured(z: Image, factor: float, noise: float, unit: float, rng: np.random.Generator) -> NDArray[np.uint16]:
    """Depth as stereo measures it, in units of `unit` [m]."""
    noisy = z * np.float32(factor) + np.float32(noise) * rng.standard_normal(z.shape, dtype=np.float32)
    return np.where(z > 0, np.clip(np.rint(noisy / unit), 0, 65535), 0).astype(np.uint16)


def _background(rng: np.random.Generator, height: int, width: int) -> Image:
    """Something dim and uneven behind the board."""
    cv2 = opencv()
    coarse = rng.uniform(0.12, 0.45, (12, 20)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.float32)


def _blurred(fine: Image, exposure: Exposure, s: int) -> Image:
    """Defocus and motion blur of a picture with `s` sub-pixels per pixel."""
    cv2 = opencv()
    if exposure.defocus > 0:
        fine = cv2.GaussianBlur(fine, (0, 0), exposure.defocus * s)
    du, dv = exposure.motion[0] * s, exposure.motion[1] * s
    length = int(np.ceil(np.hypot(du, dv)))
    if length > 1:
        kernel = np.zeros((length | 1, length | 1), np.float32)
        steps = np.linspace(-0.5, 0.5, 4 * length)
        half = (length | 1) // 2
        np.add.at(kernel, (np.rint(half + steps * dv).astype(int), np.rint(half + steps * du).astype(int)), 1.0)
        fine = cv2.filter2D(fine, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(fine, dtype=np.float32)
