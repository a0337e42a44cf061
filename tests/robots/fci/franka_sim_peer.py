"""Starts franka-sim on one loopback address, for tests; runs in franka-sim's own environment.

franka-sim 1.1.7 takes link7 for the flange, 0.107 m too low; here it measures from link8, as the real controller does.
"""

import argparse
import sys

import mujoco
from franka_sim import FrankaSimServer
from franka_sim.mujoco_franka_sim import MujocoFrankaSim

bind = MujocoFrankaSim._bind_model


def bind_to_flange(sim: MujocoFrankaSim) -> None:
    """As before, but the end effector hangs on link8."""
    bind(sim)
    sim.ee_body_id = mujoco.mj_name2id(sim.model, mujoco.mjtObj.mjOBJ_BODY, f"{sim.prefix}link8")
    assert sim.ee_body_id >= 0


MujocoFrankaSim._bind_model = bind_to_flange

parser = argparse.ArgumentParser()
parser.add_argument("--host", required=True)
parser.add_argument("--object-width", type=float, default=None)
parser.add_argument("--loose", action="store_true", help="check no limits and no lost packets")
given = parser.parse_args()
server = FrankaSimServer(
    host=given.host,
    gripper_object_width=given.object_width,
    enforce_comm_constraints=not given.loose,
    enforce_motion_limits=not given.loose,
)
sys.stdout.write("starting\n")
sys.stdout.flush()
server.start()
