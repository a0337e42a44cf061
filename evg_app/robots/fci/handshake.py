"""At connect: does the controller's idea of hand, tool and load agree with our model?"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from evg_app.config.franka import FciModel
from evg_app.config.models import RobotConfig
from evg_app.errors import Refused
from evg_app.geometry import T_GRASP_TCP, Array, invert, make, rotation_about, rotation_angle
from evg_app.robots.fci.messages import Configure, Facts

FRAME_TOLERANCE_M, FRAME_TOLERANCE_RAD = 0.001, np.deg2rad(0.5)
"""The controller's frames may differ from ours by this much [m], [rad]."""
MASS_TOLERANCE_KG = 0.1
"""Mass of hand and load may differ from the config by this much [kg]."""
HAND_YAW = -np.pi / 4
"""The Franka Hand is turned by this about the flange's z [rad]."""

ToolPose = Callable[[Array], Array]
"""T_base_tcp (4, 4) by our model, for joint positions (7,) [rad]."""


@dataclass(frozen=True)
class Finding:
    """One difference between controller and model; a fault stops the run, the others are warnings."""

    text: str
    fault: bool = False


def expected_tool(robot: RobotConfig) -> Array:
    """T_flange_tcp of the Franka Hand as our model has it. Shape (4, 4)."""
    height = robot.gripper.hand_to_grasp_z_m + float(T_GRASP_TCP[2, 3])
    return make(rotation_about("z", HAND_YAW)[:3, :3], (0.0, 0.0, height))


def configuration(robot: RobotConfig, facts: Facts) -> Configure:
    """What to tell the controller: our tool frame, load and collision thresholds."""
    fci, wanted = robot.fci, expected_tool(robot)
    frame = None if _same(facts.F_T_EE, wanted) else invert(facts.F_T_NE) @ wanted
    force = (*fci.collision_force_n, *fci.collision_moment_nm)
    return Configure(frame, fci.load_mass_kg, fci.load_center_m, fci.collision_torque_nm, force)


def differences(robot: RobotConfig, before: Facts, after: Facts, tool_pose: ToolPose) -> list[Finding]:
    """What still differs after the controller was configured, and what was corrected."""
    found: list[Finding] = []
    wanted = expected_tool(robot)
    if not _same(after.F_T_EE, wanted):
        text = f"the controller's end effector frame is {_apart(after.F_T_EE, wanted)} from our tool"
        found.append(Finding(f"{text}. In Desk, set the end effector 'Franka Hand'", fault=True))
    elif not _same(before.F_T_EE, wanted):
        found.append(
            Finding(f"the controller's end effector frame was {_apart(before.F_T_EE, wanted)} from ours; it is set now")
        )
    seen, ours = after.O_T_EE @ invert(after.F_T_EE) @ wanted, tool_pose(after.q)
    if not _same(seen, ours):
        text = f"the controller puts the tool {_apart(seen, ours)} from where our model of '{robot.name}' does"
        found.append(Finding(f"{text}: is this the right robot config? Use --robot fr3 or your own", fault=True))
    return found + _masses(robot.fci, after)


def _masses(fci: FciModel, facts: Facts) -> list[Finding]:
    """What differs in the masses of hand and load."""
    found = []
    if abs(facts.m_ee - fci.hand_mass_kg) > MASS_TOLERANCE_KG:
        text = f"the controller was told of a hand of {facts.m_ee:.2f} kg, the config says {fci.hand_mass_kg:.2f} kg"
        found.append(Finding(f"{text}: forces will be off. In Desk, set the end effector 'Franka Hand'"))
    if abs(facts.m_load - fci.load_mass_kg) > MASS_TOLERANCE_KG:
        text = f"the controller has a load of {facts.m_load:.2f} kg, the config says {fci.load_mass_kg:.2f} kg"
        found.append(Finding(text, fault=True))
    return found


def require(found: list[Finding]) -> tuple[str, ...]:
    """The warnings, if there is no fault.

    Raises:
        Refused: with every fault.
    """
    faults = [f.text for f in found if f.fault]
    if faults:
        raise Refused("; ".join(faults))
    return tuple(f.text for f in found)


def _same(a: Array, b: Array) -> bool:
    """Whether two frames agree within the tolerances."""
    apart = float(np.linalg.norm(a[:3, 3] - b[:3, 3]))
    return apart < FRAME_TOLERANCE_M and float(rotation_angle(a[:3, :3], b[:3, :3])) < FRAME_TOLERANCE_RAD


def _apart(a: Array, b: Array) -> str:
    """How far two frames are apart, in words."""
    turned = np.rad2deg(float(rotation_angle(a[:3, :3], b[:3, :3])))
    return f"{np.linalg.norm(a[:3, 3] - b[:3, 3]) * 1e3:.1f} mm and {turned:.1f} degrees"
