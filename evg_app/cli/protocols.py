"""`--protocol` and `--resume` of `evg-app run`."""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evg_app.config.models import WorldConfig
from evg_app.config.protocol import ProtocolConfig, load_protocol
from evg_app.errors import BadInput
from evg_app.grasping.protocol import Planner
from evg_app.trials.protocol import plan_round
from evg_app.trials.resume import finished_rounds, require_same

FIXED = {"rounds": 1, "seeds": (0,), "scene": "packed"}
"""Options that a protocol sets, with their defaults: who names a protocol may not set them too."""


@dataclass(frozen=True)
class Procedure:
    """What a run goes by.

    Attributes:
        protocol: the published procedure, None without one.
        done: rounds (seed, index) that an earlier session finished.
    """

    protocol: ProtocolConfig | None
    done: frozenset[tuple[int, int]]

    def placement(self, seed: int, index: int) -> dict[str, object]:
        """What round `index` asks of the operator, for the log."""
        return {} if self.protocol is None else plan_round(self.protocol, index, seed).facts()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        "--protocol",
        metavar="NAME",
        help="sim/protocols/NAME.yaml: a published procedure, sets --scene, --rounds and --seed (docs/trials.md)",
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on in --run-dir: finished rounds stay, others are begun again"
    )


def apply_protocol(args: argparse.Namespace) -> ProtocolConfig | None:
    """Read the protocol and set the options that it fixes; None without one.

    Raises:
        BadInput: the protocol is unknown or broken, or one of its options was given too.
    """
    if args.resume and args.run_dir is None:
        raise BadInput("--resume needs --run-dir DIR, the folder of the run to go on with")
    if args.protocol is None:
        return None
    protocol = load_protocol(args.protocol, args.config_dir)
    given = [f"--{name.rstrip('s') if name == 'seeds' else name}" for name, v in FIXED.items() if vars(args)[name] != v]
    if given:
        raise BadInput(f"{', '.join(given)} and --protocol {args.protocol} exclude each other: the protocol sets them")
    args.scene, args.rounds, args.seeds = protocol.scene, protocol.rounds, (protocol.seed,)
    return protocol


def world_of(world: WorldConfig, protocol: ProtocolConfig | None) -> WorldConfig:
    """The simulated scene with as many objects as the protocol asks for."""
    return world if protocol is None else world.model_copy(update={"count": protocol.objects_per_round})


def facts(protocol: ProtocolConfig | None) -> dict[str, Any]:
    """The protocol's part of the run's configuration."""
    return {} if protocol is None else {"protocol": protocol.model_dump(mode="json")}


def procedure(
    args: argparse.Namespace,
    protocol: ProtocolConfig | None,
    folder: Path,
    config: Mapping[str, Any],
    planner: Planner,
) -> Procedure:
    """The protocol, and with `--resume` the rounds that an earlier session finished.

    Raises:
        BadInput: there is no such run, or it was made with another setting.
    """
    if not args.resume:
        return Procedure(protocol, frozenset())
    require_same(folder, config, planner.name, planner.weights_sha256)
    return Procedure(protocol, finished_rounds(folder))
