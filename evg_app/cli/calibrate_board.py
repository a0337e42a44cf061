"""`evg-app calibrate board`: a board as a printable PDF, and its YAML.

Example: `evg-app calibrate board charuco_a4`, or a new one:
`evg-app calibrate board big --kind charuco --columns 7 --rows 10 --square-mm 38 --marker-mm 28 --paper a3`
"""

import argparse
from pathlib import Path

from evg_app.cli.arguments import count
from evg_app.cli.console import hushed, say
from evg_app.errors import BadInput


def add_parser(verbs: "argparse._SubParsersAction[argparse.ArgumentParser]") -> None:
    """Declare `calibrate board`."""
    parser = verbs.add_parser("board", help="write a printable board", description=__doc__)
    parser.add_argument("name", metavar="NAME", help="a board in calibration/boards/, or the name of a new one")
    parser.add_argument("--kind", choices=("charuco", "apriltag-grid"), help="makes a new board")
    parser.add_argument("--columns", type=count, default=5, metavar="N", help="squares or tags (default: 5)")
    parser.add_argument("--rows", type=count, default=7, metavar="N", help="squares or tags (default: 7)")
    parser.add_argument("--square-mm", type=float, default=36.0, metavar="MM", help="side of a square or tag")
    parser.add_argument("--marker-mm", type=float, default=27.0, metavar="MM", help="marker (ChArUco), or gap (grid)")
    parser.add_argument("--paper", choices=("a4", "a3", "letter"), default="a4", help="(default: a4)")
    parser.add_argument("--out", type=Path, default=Path("calibration/boards"), metavar="DIR", help="where both go")
    parser.add_argument("--config-dir", type=Path, metavar="DIR", help="your own calibration/boards/")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the PDF, and for a new board its YAML. Returns 0.

    Raises:
        EvgError: the name is taken or unknown, or the board does not fit on the paper.
    """
    with hushed():
        import yaml
        from pydantic import ValidationError

        from evg_app.handeye.boards import Board, BoardModel, known_boards, load_board
        from evg_app.handeye.paper import write_pdf
    args.out.mkdir(parents=True, exist_ok=True)
    if args.kind is None:
        board = load_board(args.name, args.config_dir)
    else:
        if args.name in known_boards(args.config_dir):
            raise BadInput(f"board '{args.name}' exists already; give the new one another name")
        try:
            model = BoardModel(
                name=args.name,
                kind=args.kind,
                columns=args.columns,
                rows=args.rows,
                square_m=args.square_mm / 1000,
                marker_m=args.marker_mm / 1000,
            )
        except ValidationError as error:
            raise BadInput(f"no such board can be made: {error.errors()[0]['msg']}") from error
        board = Board(model)
    pdf = args.out / f"{args.name}.pdf"
    write_pdf(board, pdf, args.paper)
    say(f"{pdf}: print at 100 %, check the ruler, glue it onto a flat plate")
    if args.kind is not None:
        path = args.out / f"{args.name}.yaml"
        path.write_text(yaml.safe_dump(board.model.model_dump(), sort_keys=False), encoding="utf-8")
        say(f"{path}: name it with --board {args.name}")
    return 0
