"""The course of a training as a picture: every measured number over scene visits."""

import csv
import logging
from pathlib import Path

import numpy as np

log = logging.getLogger(__name__)

PANELS = (
    ("average precision", ("graspness_ap", "score_ap", "contact_ap", "proposals_ap")),
    ("rotation error, median [deg]", ("regressed_deg", "flow_deg")),
    ("occupancy IoU", ("occupancy_iou",)),
    ("width error, median [mm]", ("width_mm",)),
)
"""What is drawn together: the panel's title, and columns of metrics.csv (those that are there)."""


def draw_curves(table: Path) -> Path | None:
    """Draw `metrics.csv` as `metrics.png` beside it; None (and a hint) without matplotlib."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        log.info("no curve picture: matplotlib is missing; install the extra 'train'")
        return None
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    visits = np.array([float(row["scene_visits"]) for row in rows])
    figure = Figure(figsize=(10, 6), layout="constrained")
    for axes, (title, columns) in zip(figure.subplots(2, 2).flat, PANELS, strict=True):
        for column in columns:
            if column in rows[0]:
                axes.plot(visits, [float(row[column]) for row in rows], marker=".", label=column)
        axes.set_title(title)
        axes.set_xlabel("scene visits")
        axes.grid(alpha=0.3)
        if axes.lines:
            axes.legend()
    path = table.with_suffix(".png")
    FigureCanvasAgg(figure).print_png(str(path))
    return path
