"""What passes between the application and the processes that speak libfranka."""

from dataclasses import dataclass

from evg_app.geometry import Array


@dataclass(frozen=True)
class Facts:
    """What the controller says about itself at connect. Transforms are (4, 4), forces in [N] and [Nm].

    Attributes:
        library: version of pylibfranka.
        F_T_NE, NE_T_EE, F_T_EE: flange to nominal end effector to end effector.
        O_T_EE: end effector in the base, at `q` (7,) [rad].
        m_ee, m_load: mass of end effector and load [kg].
        error_names: name of each bit of a state's `errors`.
        realtime: what scheduling the streaming process got, in words.
    """

    library: str
    q: Array
    F_T_NE: Array
    NE_T_EE: Array
    F_T_EE: Array
    O_T_EE: Array
    m_ee: float
    m_load: float
    error_names: tuple[str, ...]
    realtime: str


@dataclass(frozen=True)
class Failed:
    """Connecting or a request failed: `kind` is the name of the exception, `text` its words."""

    kind: str
    text: str


@dataclass(frozen=True)
class Execute:
    """Stream a trajectory: samples (M, 7) every `dt` [s]; `acceleration` and `jerk` (7,) limit braking."""

    motion: int
    q: Array
    dq: Array
    ddq: Array
    dt: float
    acceleration: Array
    jerk: Array


@dataclass(frozen=True)
class Started:
    """The controller took the motion of this number."""

    motion: int


@dataclass(frozen=True)
class Ended:
    """A motion ended.

    Attributes:
        stopped: it was braked before its end, because of `reason`.
        failed: the controller aborted it, with `reason`.
        goal_error: largest joint distance to the goal [rad].
        lost: states lost during the motion.
        cycles: cycles of the motion.
    """

    motion: int
    reason: str
    stopped: bool
    failed: bool
    goal_error: float
    lost: int
    cycles: int


@dataclass(frozen=True)
class Recover:
    """Run the controller's automatic error recovery."""


@dataclass(frozen=True)
class Configure:
    """Set end effector frame NE_T_EE (4, 4), load and collision thresholds (7,), (6,)."""

    NE_T_EE: Array | None
    load_mass_kg: float
    load_center_m: tuple[float, float, float]
    torque_nm: tuple[float, ...]
    force: tuple[float, ...]


@dataclass(frozen=True)
class Done:
    """A request was carried out; `facts` are new after `Configure`."""

    facts: Facts | None = None


@dataclass(frozen=True)
class Leave:
    """End the process."""


@dataclass(frozen=True)
class Grip:
    """A gripper command: "homing", "move", "grasp", "stop" or "read", with libfranka's arguments."""

    command: str
    arguments: tuple[float, ...] = ()


@dataclass(frozen=True)
class Gripped:
    """What a gripper command ended with: the device's verdict, opening and widest opening [m], its flag, when [s].

    `server` is the version of the protocol that the hand speaks.
    """

    success: bool
    width: float
    max_width: float
    is_grasped: bool
    stamp: float
    message: str = ""
    server: int = 0
