"""librealsense's filters as the config asks for them."""

from typing import Any

from evg_app.config.camera import CameraConfig


def smoothing(rs: Any, config: CameraConfig) -> list[Any]:
    """Filters in their recommended order, none that remembers earlier frames or fills holes; empty by default."""
    wanted = config.realsense.spatial
    if wanted is None:
        return []
    spatial = rs.spatial_filter()
    spatial.set_option(rs.option.filter_magnitude, wanted.magnitude)
    spatial.set_option(rs.option.filter_smooth_alpha, wanted.alpha)
    spatial.set_option(rs.option.filter_smooth_delta, wanted.delta)
    spatial.set_option(rs.option.holes_fill, 0)
    return [rs.disparity_transform(True), spatial, rs.disparity_transform(False)]
