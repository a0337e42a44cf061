"""Files of a lab without hardware: a calibration that is true, and stored frames of a simulated table."""

import os
from pathlib import Path

import numpy as np
from calibrated import calibrated

from evg_app.config.files import load_camera, load_robot, load_world
from evg_app.simulation.builtin import builtin_objects
from evg_app.simulation.camera import SimulatedCamera
from evg_app.simulation.world import SimRounds, SimWorld


def lab_files(folder: Path) -> Path:
    """Writes `calibration/` and `frames/attempts/`: a packed table that does not change. Returns the frames' folder."""
    camera = load_camera("d435i")
    world = SimWorld(load_robot("panda"), load_world("packed"), builtin_objects("test"))
    try:
        SimRounds(world).prepare(0, 0)
        device = SimulatedCamera(world, camera)
        calibrated(folder, camera, device.T_base_cam)
        full = device.capture(after=0.0, timeout=5.0)
    finally:
        world.close()
    frames = folder / "frames"
    (frames / "attempts").mkdir(parents=True)
    for number, frame in enumerate((full, full, full)):
        path = frames / "attempts" / f"{number}.npz"
        K = frame.intrinsics
        np.savez_compressed(
            path,
            depth=frame.depth,
            depth_scale=frame.depth_scale,
            image_size=np.array([K.width, K.height]),
            focal_centre=np.array([K.fx, K.fy, K.cx, K.cy]),
            distortion=np.zeros(0),
        )
        os.utime(path, (1e9 + number, 1e9 + number))
    return frames
