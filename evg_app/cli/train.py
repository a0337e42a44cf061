"""`evg-app train`: train a network on generated scenes and export its weights."""

import argparse
import logging
from pathlib import Path

from evg_app.errors import BadInput, Stopped

SUMMARY = "train a network on generated scenes, resuming where it stopped; with --export also write the weights"

WITHOUT = ("s2tp", "eda", "proposals")
"""What can be left out: two parts of the network, and the tried proposals of a network in the data."""


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb `train`."""
    parser = subparsers.add_parser("train", help="train a grasp network on generated scenes", description=SUMMARY)
    parser.add_argument(
        "--data",
        type=Path,
        required=True,
        action="append",
        metavar="DIR",
        help="folder of shards from evg-app generate; may be given several times",
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of the checkpoint and metrics.csv"
    )
    parser.add_argument("--minutes", type=float, default=60.0, help="training time in all, across resumes (default 60)")
    parser.add_argument("--batch", type=int, default=6, help="scenes per step (default 6)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--device", default="cpu", help="where to train: cpu or cuda (default cpu)")
    parser.add_argument("--model", choices=("equiigd", "equigiga"), default="equiigd")
    parser.add_argument("--learning-rate", type=float, default=1e-3, help="highest (default 0.001)")
    parser.add_argument("--start", metavar="FILE", help="weights to start from instead of random ones")
    parser.add_argument("--side", choices=("exact", "mixed"), default="exact", help="side branch (default exact)")
    parser.add_argument(
        "--symmetry",
        choices=("c4", "plain"),
        default="c4",
        help="plain: free layers and equally many parameters, to compare with (default c4; plain ignores --side)",
    )
    parser.add_argument(
        "--without",
        choices=WITHOUT,
        action="append",
        default=[],
        help="leave a part out, to measure what it brings; may be given several times",
    )
    parser.add_argument("--export", type=Path, metavar="FILE", help="NAME.safetensors to write at the end")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Train until the time is used up. Returns 0.

    Raises:
        BadInput: what is to be left out is not in the model, or see `train`.
        Stopped: Ctrl-C or `kill`; the checkpoint holds every step.
    """
    if args.model == "equigiga" and {"eda", "proposals"} & set(args.without):
        raise BadInput("EquiGIGA has neither EDA nor a grasp classifier; only --without s2tp fits --model equigiga")
    from evg_app.learning.batches import BatchSizes
    from evg_app.learning.train import TrainConfig, restart_with_allocator, train
    from evg_app.nets.config import plain_counterpart
    from evg_app.picking.stop import StopToken

    restart_with_allocator()
    logging.getLogger("evg_app").setLevel(logging.INFO)
    network = {"side": args.side} if args.symmetry == "c4" else plain_counterpart(args.model)
    network |= {"contact_score": True} if args.model == "equiigd" else {}
    network |= {part: False for part in args.without if part != "proposals"}
    sizes = BatchSizes(proposals=0) if "proposals" in args.without else BatchSizes()
    config = TrainConfig(
        minutes=args.minutes,
        batch=args.batch,
        sizes=sizes,
        seed=args.seed,
        learning_rate=args.learning_rate,
        architecture=args.model,
        network=network,
        device=args.device,
        start=args.start,
    )
    stop = StopToken()
    with stop.on_signals(), stop.shielded():  # a step that is torn apart cannot be saved
        checkpoint = train(config, args.data, args.out, lambda: stop.soft)
    if stop.soft:
        raise Stopped(f"every step is saved in {checkpoint}; the same command goes on")
    if args.export is not None:
        from evg_app.learning.export import export_weights

        export_weights(checkpoint, args.export)
    return 0
