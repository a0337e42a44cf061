"""Which Franka arm speaks to which library, and what to do about a refusal to connect. See docs/franka.md."""

import re

ADVICE = (
    ("Incompatible", "{incompatible}"),
    ("refused", "Desk: unlock the joints and activate FCI, then try again."),
    ("realtime", "Set 'realtime: ignore' under fci: in the robot's YAML, or see docs/franka.md on the kernel."),
    ("real-time", "Set 'realtime: ignore' under fci: in the robot's YAML, or see docs/franka.md on the kernel."),
    ("ould not be resolved", "Check fci.host in the robot's YAML, or give --host ADDRESS."),
    ("imeout", "Is the robot on, FCI active in Desk, and the PC on the network of the control box? Run: ping {host}"),
)


def connect_advice(kind: str, text: str, host: str) -> str:
    """What to do about libfranka's refusal to connect."""
    if kind == "ImportError":
        return "Run: ./setup.sh franka"
    for word, sentence in ADVICE:
        if word in text:
            return sentence.format(host=host, incompatible=_incompatible(text))
    return f"Run: ping {host}, and look at Desk (https://{host}): joints unlocked, FCI active, no other client."


def _incompatible(text: str) -> str:
    """By the protocol version of the robot: 5 and below is the Panda (FER)."""
    found = re.search(r"server version:?\s*(\d+)", text)
    server = int(found[1]) if found else 0
    if 0 < server < 6:
        return (
            f"The robot speaks protocol {server}: a Panda (FER), whose last library is libfranka 0.9. pylibfranka "
            "speaks to the FR3 only. Use --driver ros2 with a ROS 2 driver for the Panda; docs/franka.md says which."
        )
    return (
        f"The robot speaks protocol {server or 'unknown'}. Install the pylibfranka of your system version: "
        "docs/franka.md has the table; .venv/bin/pip install pylibfranka==VERSION"
    )
