"""What decides whether two ROS 2 machines see each other: middleware, domain and discovery range."""

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass

MAX_DOMAIN = 101
"""Largest domain whose ports are clear of Linux's ephemeral range."""
RANGES = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
DEFAULT_RMW = "rmw_fastrtps_cpp"


@dataclass(frozen=True)
class Network:
    """The ROS 2 environment of this process.

    Attributes:
        rmw: the middleware.
        domain: ROS_DOMAIN_ID as given, "0" when unset.
        discovery: ROS_AUTOMATIC_DISCOVERY_RANGE, SUBNET when unset.
        peers: ROS_STATIC_PEERS, empty when unset.
        faults: settings that cannot work; each says what to do.
        notes: settings to know about; each says what to do.
    """

    rmw: str
    domain: str
    discovery: str
    peers: str
    faults: tuple[str, ...]
    notes: tuple[str, ...]

    def __str__(self) -> str:
        """On one line."""
        peers = f", static peers {self.peers}" if self.peers else ""
        return f"{self.rmw}, ROS_DOMAIN_ID {self.domain}, discovery range {self.discovery}{peers}"


def network(environment: Mapping[str, str] = os.environ) -> Network:
    """Read and judge the environment."""
    rmw = environment.get("RMW_IMPLEMENTATION") or DEFAULT_RMW
    domain = environment.get("ROS_DOMAIN_ID") or "0"
    discovery = (environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET").upper()
    faults: list[str] = []
    notes: list[str] = []
    if not domain.isdecimal():
        faults.append(f"ROS_DOMAIN_ID '{domain}' is not a number. Run: export ROS_DOMAIN_ID=0")
    elif int(domain) > MAX_DOMAIN:
        notes.append(f"ROS_DOMAIN_ID {domain} is above {MAX_DOMAIN}: its ports may collide with others'")
    if discovery not in RANGES:
        faults.append(f"ROS_AUTOMATIC_DISCOVERY_RANGE '{discovery}' is none of {', '.join(RANGES)}")
    if discovery == "OFF":
        notes.append("ROS_AUTOMATIC_DISCOVERY_RANGE=OFF: nothing is found unless ROS_STATIC_PEERS names it")
    if discovery == "LOCALHOST":
        notes.append("only this computer is seen; for a robot driver elsewhere: unset ROS_AUTOMATIC_DISCOVERY_RANGE")
    if "ROS_LOCALHOST_ONLY" in environment:
        notes.append("ROS_LOCALHOST_ONLY is deprecated; use ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST")
    if rmw == DEFAULT_RMW and discovery == "SUBNET":
        notes.append(
            "with the default middleware and a second computer on the network, Franka users saw "
            "communication_constraints_violation; rmw_cyclonedds_cpp on every computer cured it"
        )
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    foreign = [p for p in environment.get("PYTHONPATH", "").split(os.pathsep) if "/opt/ros/" in p and python not in p]
    if foreign:
        faults.append(
            f"PYTHONPATH holds a ROS of another Python ({foreign[0]}); this is {python}. "
            "Open a shell without `source /opt/ros/.../setup.bash`: the two meet on the network, not in one process"
        )
    peers = environment.get("ROS_STATIC_PEERS", "")
    return Network(rmw, domain, discovery, peers, tuple(faults), tuple(notes))
