"""Real-time scheduling for the streaming process: what the machine allows, what was taken, and plain advice."""

import contextlib
import os
import platform
import resource
from dataclasses import dataclass
from pathlib import Path

ENOUGH_CORES = 4
"""With fewer CPUs none is set apart for the streaming process."""


@dataclass(frozen=True)
class Machine:
    """What matters of this machine.

    Attributes:
        realtime_kernel: the kernel is PREEMPT_RT.
        priority: highest real-time priority that this user may take.
        governor: of the first CPU, "" when unknown.
        cores: CPUs this process may use.
    """

    realtime_kernel: bool
    priority: int
    governor: str
    cores: tuple[int, ...]


def machine() -> Machine:
    """Look at this machine."""
    flag, governor = Path("/sys/kernel/realtime"), Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    realtime = "PREEMPT_RT" in platform.version() or (flag.is_file() and flag.read_text().strip() == "1")
    soft, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
    allowed = 99 if os.geteuid() == 0 or soft == resource.RLIM_INFINITY else soft
    text = governor.read_text().strip() if governor.is_file() else ""
    return Machine(realtime, allowed, text, tuple(sorted(os.sched_getaffinity(0))))


def advice(found: Machine) -> list[str]:
    """What to change so that fewer packets are lost; empty when all is well."""
    lines = []
    if not found.realtime_kernel:
        lines.append(
            "this kernel is not PREEMPT_RT: expect lost packets under load. "
            "Ubuntu 24.04: sudo pro enable realtime-kernel"
        )
    if found.priority < 1:
        lines.append(
            "this user may not take real-time priority. Add '@realtime - rtprio 99' and "
            "'@realtime - memlock unlimited' "
            "to /etc/security/limits.d/realtime.conf, sudo usermod -aG realtime $USER, and log in again"
        )
    if found.governor not in ("", "performance"):
        lines.append(f"the CPU governor is '{found.governor}'. Run: sudo cpupower frequency-set -g performance")
    return lines


def choose_core(cores: tuple[int, ...], wanted: int | None) -> int | None:
    """The CPU for the streaming process: the wanted one, else the last of four or more, else none."""
    if wanted is not None:
        return wanted if wanted in cores else None
    return cores[-1] if len(cores) >= ENOUGH_CORES else None


def take(found: Machine, priority: int, core: int | None) -> str:
    """Give the calling process its CPU and real-time priority, as far as allowed; what it got, in words."""
    got = []
    chosen = choose_core(found.cores, core)
    if chosen is not None:
        with contextlib.suppress(OSError):
            os.sched_setaffinity(0, {chosen})
            got.append(f"CPU {chosen}")
    if found.priority >= 1:
        level = min(priority, found.priority)
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(level))
            got.append(f"SCHED_FIFO {level}")
    return ", ".join(got) or "ordinary scheduling"


def leave_core(found: Machine, core: int | None) -> None:
    """Keep the calling process off the streaming process's CPU."""
    chosen = choose_core(found.cores, core)
    if chosen is not None and len(found.cores) > 1:
        with contextlib.suppress(OSError):
            os.sched_setaffinity(0, set(found.cores) - {chosen})
