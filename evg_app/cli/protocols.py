"""`--protocol` and `--resume` of `evg-app run`."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evg_app.config.models import WorldConfig
from evg_app.config.protocol import ProtocolConfig, load_protocol
from evg_app.errors import BadInput
from evg_app.trials.resume import finished_rounds, require_same

FIXED = {"rounds": 1, "seeds": (0,), "scene": "packed"}
"""Options that a protocol sets, with their defaults: who names a protocol may not set them too."""


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


def rounds_done(
    args: argparse.Namespace, folder: Path, config: Mapping[str, Any], model: str, weights_sha256: str
) -> frozenset[tuple[int, int]]:
    """Rounds that an earlier session finished; none unless `--resume`.

    Raises:
        BadInput: there is no such run, or it was made with another setting.
    """
    if not args.resume:
        return frozenset()
    require_same(folder, config, model, weights_sha256)
    return finished_rounds(folder)
