"""Is the camera good enough for a run? Everything that can be measured on one frame of a table whose place is known."""

from collections.abc import Mapping
from dataclasses import dataclass

from evg_app.config.camera import CameraConfig
from evg_app.errors import Refused
from evg_app.geometry import Array
from evg_app.perception.health import DepthHealth, depth_health
from evg_app.perception.table_health import TableHealth, table_health
from evg_app.types import Frame


@dataclass(frozen=True)
class RunHealth:
    """The measures of one frame, and what is wrong with them.

    Attributes:
        depth: how the workspace is seen.
        table: how the table is seen.
        advice: what is wrong and what to do, empty when a run may start.
    """

    depth: DepthHealth
    table: TableHealth
    advice: str

    @property
    def ok(self) -> bool:
        """Whether a run may start."""
        return not self.advice

    def measures(self) -> Mapping[str, float]:
        """Every number, for the log: shares, [m] and [deg]."""
        return {
            "in_view": self.depth.in_view,
            "valid": self.depth.valid,
            "near": self.depth.near,
            "table_share": self.table.share,
            "table_noise_m": self.table.noise,
            "table_bias_m": self.table.bias,
            "table_bias_ratio": self.table.bias_ratio,
            "table_tilt_deg": self.table.tilt_deg,
        }

    def text(self) -> str:
        """One line for a person."""
        depth = f"{self.depth.in_view:.0%} of the workspace in view, {self.depth.valid:.0%} of it with depth"
        if not self.table.seen:
            return f"{depth}; the table was not recognised"
        table = self.table
        return (
            f"{depth}; table: noise {table.noise * 1e3:.1f} mm, distance {table.bias * 1e3:+.1f} mm "
            f"({table.bias_ratio:+.1%}), tilt {table.tilt_deg:.1f} deg"
        )

    def require(self) -> None:
        """Pass when ok.

        Raises:
            Refused: with the numbers and the advice.
        """
        if not self.ok:
            raise Refused(f"depth is not good enough for a run: {self.text()}. {self.advice}")


def run_health(frame: Frame, T_cam_task: Array, config: CameraConfig) -> RunHealth:
    """Judge a frame of the still table by the limits of the camera config. T_cam_task: (4, 4)."""
    depth = depth_health(frame, T_cam_task, config.min_valid_ratio)
    table = table_health(frame, T_cam_task)
    return RunHealth(depth, table, depth.advice or _advice(table, config))


def _advice(table: TableHealth, config: CameraConfig) -> str:
    """The first thing to mend, or nothing."""
    if not table.seen:
        return (
            "The table does not lie where T_base_task and the calibration put it, or most of it is covered. "
            "Run: evg-app calibrate verify, then evg-app workspace"
        )
    if table.noise > config.max_table_noise_m:
        return (
            f"The table's depth is noisy (allowed {config.max_table_noise_m * 1e3:.1f} mm): more light or texture, "
            "laser on, camera 0.3 to 1 m away, clean lenses, or more realsense.average_frames. "
            "Run: evg-app doctor --camera"
        )
    if table.tilt_deg > config.max_table_tilt_deg:
        return (
            f"The table looks tilted (allowed {config.max_table_tilt_deg:.1f} deg): the camera was moved or the "
            "calibration is wrong. Run: evg-app calibrate verify"
        )
    if abs(table.bias_ratio) > config.max_table_bias_ratio:
        return (
            f"The table is measured {table.bias * 1e3:+.0f} mm off (allowed {config.max_table_bias_ratio:.1%} of its "
            "distance): the table's height in T_base_task, the calibration, or the camera's own depth calibration is "
            "wrong. Run: evg-app calibrate verify"
        )
    return ""
