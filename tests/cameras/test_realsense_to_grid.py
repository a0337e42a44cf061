"""From the sensor to the grid: what librealsense's pipeline gives fuses to what the renderer's own frame does."""

import numpy as np
import pytest
from recordings import write_recording

from evg_app.cameras.realsense.camera import RealSenseCamera
from evg_app.cameras.realsense.start import Recording
from evg_app.clock import WallClock
from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.geometry import invert
from evg_app.perception.tsdf import fuse
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.camera import SimulatedCamera
from evg_app.simulation.world import SimRounds, SimWorld

GRID = 0.002
"""Largest difference of a voxel; the stream's intrinsics are float32 and its two focal lengths equal."""
SAME_VOXELS = 0.999
"""Share of the voxels that must be observed in both or in neither."""


@pytest.mark.slow
@pytest.mark.parametrize("average", [1, 4])
def test_grid_of_the_pipeline_is_the_grid_of_the_renderer(tmp_path, average):
    world = SimWorld(load_robot("panda"), load_world("packed"), builtin_objects("test"))
    SimRounds(world).prepare(0, 0)
    config = load_camera("d435i")
    rendered = SimulatedCamera(world, config)
    T_cam_task = invert(rendered.T_base_cam) @ world.T_base_task
    exact = rendered.capture(after=0.0, timeout=1.0)
    world.close()
    asked = config.realsense.model_copy(update={"average_frames": average})
    path = write_recording(tmp_path / "scene.db3", [exact.depth] * 10)
    with RealSenseCamera(
        config.model_copy(update={"realsense": asked}), WallClock(), recording=Recording(path, repeat=True)
    ) as camera:
        seen = camera.capture(after=0.0, timeout=5.0)
    ours, theirs = fuse([(seen, T_cam_task)]), fuse([(exact, T_cam_task)])
    assert (ours.observed == theirs.observed).mean() > SAME_VOXELS
    both = (ours.values > 0) & (theirs.values > 0)
    assert both.sum() > 1000
    assert np.quantile(np.abs(ours.values - theirs.values)[both], SAME_VOXELS) < GRID
