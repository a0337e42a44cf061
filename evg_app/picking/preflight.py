"""Before the first motion of a run: is what the camera measures good enough?"""

import numpy as np

from evg_app.events import DepthChecked
from evg_app.geometry import invert
from evg_app.perception.run_health import RunHealth, run_health
from evg_app.picking.context import Context

TRIES = 3
"""Frames to judge before a run is refused: one may hold a hand or a shadow."""


def check_depth(ctx: Context, refuse: bool = True) -> RunHealth:
    """Judge fresh frames against the known table, up to the first good one; each is shown and logged as `DepthChecked`.

    Args:
        ctx: with entered devices and the arm at rest.
        refuse: whether bad depth is refused; False when the arm may hide the table.

    Raises:
        Refused: no frame was good enough; holds the numbers of the last and what to do.
        DeviceTimeout: no frame came.
    """
    health = _judge(ctx)
    for _ in range(TRIES - 1):
        if health.ok:
            break
        health = _judge(ctx)
    if refuse:
        health.require()
    return health


def _judge(ctx: Context) -> RunHealth:
    """Take one frame, judge it, and tell."""
    clock, perception = ctx.devices.clock, ctx.perception
    q = ctx.devices.arm.state().q
    frame = ctx.devices.camera.capture(after=clock.now(), timeout=ctx.camera.frame_timeout_s)
    T_cam_task = np.asarray(invert(perception.T_base_cam(q)) @ perception.T_base_task)
    health = run_health(perception.clean(frame, q), T_cam_task, ctx.camera)
    ctx.sink(DepthChecked(dict(health.measures()), health.text(), health.advice))
    return health
