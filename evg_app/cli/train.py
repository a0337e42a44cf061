"""`evg-app train`: train EquiIGD on generated scenes and export its weights."""

import argparse
import logging
from pathlib import Path

SUMMARY = "train EquiIGD on generated scenes, resuming where it stopped; with --export also write the weights"


def add_parser(subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Add the verb `train`."""
    parser = subparsers.add_parser("train", help="train a grasp network on generated scenes", description=SUMMARY)
    parser.add_argument(
        "--data", type=Path, required=True, metavar="DIR", help="folder of shards from evg-app generate"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of the checkpoint and metrics.csv"
    )
    parser.add_argument("--minutes", type=float, default=60.0, help="training time in all, across resumes (default 60)")
    parser.add_argument("--batch", type=int, default=6, help="scenes per step (default 6)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--side", choices=("exact", "mixed"), default="exact", help="side branch (default exact)")
    parser.add_argument("--export", type=Path, metavar="FILE", help="NAME.safetensors to write at the end")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Train until the time is used up. Returns 0."""
    from evg_app.learning.train import TrainConfig, restart_with_allocator, train

    restart_with_allocator()
    logging.getLogger("evg_app").setLevel(logging.INFO)
    config = TrainConfig(minutes=args.minutes, batch=args.batch, seed=args.seed, network={"side": args.side})
    checkpoint = train(config, args.data, args.out)
    if args.export is not None:
        from evg_app.learning.export import export_weights

        export_weights(checkpoint, args.export)
    return 0
