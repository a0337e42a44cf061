"""Before the first motion of a run: is what the camera measures good enough?"""

from evg_app.cameras.protocol import Camera
from evg_app.clock import Clock
from evg_app.config.models import CameraConfig
from evg_app.events import DepthChecked, Sink
from evg_app.geometry import Array
from evg_app.perception.run_health import RunHealth, run_health

TRIES = 3
"""Frames to judge before a run is refused: the first may hold a hand or a shadow."""


def check_depth(camera: Camera, clock: Clock, T_cam_task: Array, config: CameraConfig, sink: Sink) -> RunHealth:
    """Judge fresh frames against the known table and say so to the log; the arm stands where it looks from.

    Args:
        camera: entered.
        clock: the camera's.
        T_cam_task: where the workspace is for the depth camera. Shape (4, 4).
        config: its limits.
        sink: gets one `DepthChecked` for each frame.

    Raises:
        Refused: no frame was good enough; holds the numbers of the last and what to do.
        DeviceTimeout: no frame came.
    """
    health = _judge(camera, clock, T_cam_task, config, sink)
    for _ in range(TRIES - 1):
        if health.ok:
            break
        health = _judge(camera, clock, T_cam_task, config, sink)
    health.require()
    return health


def _judge(camera: Camera, clock: Clock, T_cam_task: Array, config: CameraConfig, sink: Sink) -> RunHealth:
    frame = camera.capture(after=clock.now(), timeout=config.frame_timeout_s)
    health = run_health(frame, T_cam_task, config)
    sink(DepthChecked(dict(health.measures()), health.text(), health.advice))
    return health
