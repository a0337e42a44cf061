"""The same path at a share of the speed: what a new robot is driven at until a person confirms more."""

import numpy as np

from evg_app.motion.trajectory import DT
from evg_app.quintic import evaluate, quintics
from evg_app.types import Trajectory


def slowed(trajectory: Trajectory, share: float) -> Trajectory:
    """A trajectory along the same path in 1/share of the time; limits that held before hold all the more.

    Velocity shrinks with `share`, acceleration with its square, jerk with its cube. The samples are `DT` apart.
    """
    if share == 1.0:
        return trajectory
    count = max(int(np.ceil(trajectory.duration / share / DT - 1e-9)), 1)
    rate = float(trajectory.duration / (count * DT))
    x = np.arange(count + 1, dtype=np.float64) * (DT * rate / trajectory.dt)
    pieces, per_second = quintics(trajectory.q, trajectory.dq, trajectory.ddq, trajectory.dt), rate / trajectory.dt
    q, dq, ddq = (evaluate(pieces, x, n) * per_second**n for n in range(3))
    q[0], q[-1] = trajectory.q[0], trajectory.q[-1]
    dq[[0, -1]], ddq[[0, -1]] = 0.0, 0.0
    for array in (q, dq, ddq):
        array.setflags(write=False)
    return Trajectory(trajectory.joint_names, DT, q, dq, ddq)
