"""The report of one calibration as a single HTML page with pictures: verdict, errors, samples, what to mend."""

import base64
import html
from pathlib import Path

import numpy as np

from evg_app.geometry import to_quaternion
from evg_app.handeye.boards import opencv
from evg_app.handeye.sample import Sample, Session
from evg_app.handeye.solve import GO_DEG, GO_MM, WARN_MM, Solution, Unsolved

COLORS = {"go": "#1a7f37", "warn": "#9a6700", "refuse": "#cf222e"}
WORDS = {"go": "GO", "warn": "GO WITH A WARNING", "refuse": "REFUSED"}
THUMB_WIDTH = 300
STYLE = """body{font:15px/1.45 system-ui,sans-serif;max-width:1000px;margin:2em auto;color:#1f2328}
table{border-collapse:collapse;margin:.6em 0}td,th{border:1px solid #d0d7de;padding:.2em .6em;text-align:right}
th{background:#f6f8fa}td:first-child,th:first-child{text-align:left}.bad{color:#cf222e}
figure{display:inline-block;margin:4px;font-size:12px}h2{margin-top:1.4em}
.v{color:#fff;padding:.4em .8em;border-radius:6px}"""


def write_report(session: Session, solution: Solution | Unsolved, path: Path) -> None:
    """Write the page."""
    verdict = solution.verdict
    parts = [
        f"<h1>Calibration: {html.escape(session.camera)} with {html.escape(session.robot)}, {session.mode}</h1>",
        f"<p><span class=v style='background:{COLORS[verdict]}'>{WORDS[verdict]}</span></p>",
        _findings(solution),
    ]
    if isinstance(solution, Solution):
        parts += [_numbers(session, solution), _solvers(solution)]
    parts += [_coverage(session), _samples(session, solution), _pictures(session, solution)]
    page = f"<!doctype html><meta charset=utf-8><title>calibration</title><style>{STYLE}</style>{''.join(parts)}"
    path.write_text(page, encoding="utf-8")


def _findings(solution: Solution | Unsolved) -> str:
    """What was noticed, as a list."""
    if not solution.findings:
        return "<p>Nothing suspicious was found.</p>"
    rows = (f"<li><b>{f.severity}, {f.cause}</b>: {html.escape(f.text)}</li>" for f in solution.findings)
    return f"<ul>{''.join(rows)}</ul>"


def _table(head: list[str], rows: list[list[str]]) -> str:
    """A table from its head and rows."""
    top = "".join(f"<th>{h}</th>" for h in head)
    body = "".join(f"<tr>{''.join(f'<td>{c}</td>' for c in row)}</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def _numbers(session: Session, solution: Solution) -> str:
    """Errors, confidence, and the camera's pose."""
    fit, sure, held = solution.fit, solution.uncertainty, solution.heldout
    std, off = sure.stds(), solution.lens
    gates = f"good up to {GO_MM:g} mm and {GO_DEG:g} deg, with a warning up to {WARN_MM:g} mm"
    rows = [
        ["held-out error (samples that were not fitted)", f"{held.rms_mm:.2f} mm", f"{held.rms_deg:.3f} deg"],
        ["error over the workspace, 95 % upper bound", f"{sure.bound_mm:.2f} mm", f"{sure.bound_deg:.3f} deg"],
        ["reprojection, RMS", f"{fit.rms:.3f} px", ""],
        *_table_rows(solution),
        ["size of the board against its YAML", f"{100 * fit.scale:.2f} %", f"+- {100 * sure.scale_std:.2f} %"],
        ["focal length against the camera's", f"{100 * np.expm1(off[0]):+.2f} %", f"+- {100 * sure.lens_std[0]:.2f} %"],
        *(
            [f"principal point, {name}, against the camera's", f"{off[k]:+.2f} px", f"+- {sure.lens_std[k]:.2f} px"]
            for k, name in ((1, "column"), (2, "row"))
        ),
    ]
    xyz, quaternion = fit.X[:3, 3], to_quaternion(fit.X)
    place = [
        [axis, f"{1000 * xyz[k]:.2f} +- {1000 * std[k]:.2f}", f"{np.rad2deg(std[3 + k]):.3f}"]
        for k, axis in enumerate("xyz")
    ]
    words = " ".join(f"{v:.6f}" for v in quaternion)
    return (
        f"<h2>How good it is</h2>{_table(['', 'value', ''], rows)}<p>Gate: {gates}.</p>"
        f"<h2>The camera in {html.escape(session.parent_frame)}</h2>"
        f"{_table(['axis', 'position [mm]', 'rotation +- [deg]'], place)}<p>quaternion xyzw: {words}</p>"
    )


def _table_rows(solution: Solution) -> list[list[str]]:
    """What depth says about the table."""
    seen = solution.table
    if seen is None:
        return [["table seen by depth", "too little of it", ""]]
    return [
        ["table seen by depth: height and tilt", f"{seen.offset_mm:+.1f} mm", f"{seen.tilt_deg:.2f} deg"],
        ["table seen by depth: flatness (RMS)", f"{seen.flatness_mm:.1f} mm", f"{seen.points} points"],
    ]


def _solvers(solution: Solution) -> str:
    """How far OpenCV's solvers are from the result."""
    rows = [[name, "failed" if d is None else f"{d:.2f}"] for name, d in solution.solver_mm.items()]
    return f"<h2>Closed-form solvers</h2>{_table(['solver', 'mm from the result, over the workspace'], rows)}"


def _coverage(session: Session) -> str:
    """All corners used, as dots in one picture."""
    K = session.intrinsics
    dots = "".join(
        f"<circle cx='{u:.0f}' cy='{v:.0f}' r=3 fill='#0969da' fill-opacity=.35 />"
        for s in session.usable()
        for u, v in s.detection.pixels
    )
    box = f"viewBox='0 0 {K.width} {K.height}' width=500 style='border:1px solid #d0d7de'"
    return f"<h2>Where in the picture the corners were</h2><svg {box}>{dots}</svg>"


def _samples(session: Session, solution: Solution | Unsolved) -> str:
    """Every sample with its residuals."""
    errors: dict[int, tuple[float, float, float]] = {}
    if isinstance(solution, Solution):
        px = solution.fit.sample_rms(solution.views)
        held = solution.heldout
        for k, number in enumerate(solution.views.numbers):
            errors[int(number)] = (float(px[k]), float(held.mm[k]), float(held.deg[k]))
    rows = []
    for s in session.samples:
        d = s.detection
        note = _note(s, solution)
        numbers = [f"{v:.2f}" for v in errors.get(s.number, ())] or ["", "", ""]
        mark = f"<span class=bad>{html.escape(note)}</span>" if note else ""
        rows.append([str(s.number), str(len(d.ids)), f"{d.edge_width:.2f}", *numbers, mark])
    head = ["sample", "corners", "edges [px]", "fit [px]", "held out [mm]", "[deg]", "left out because"]
    return f"<h2>Samples</h2>{_table(head, rows)}"


def _note(sample: Sample, solution: Solution | Unsolved) -> str:
    """Why a sample was left out, or an empty string."""
    if isinstance(solution, Solution) and sample.number in solution.left_out:
        return "outlier"
    return sample.detection.problem


def _pictures(session: Session, solution: Solution | Unsolved) -> str:
    """Every picture with what was found in it."""
    figures = []
    for s in session.samples:
        if s.gray is not None:
            note = _note(s, solution) or "used"
            figures.append(f"<figure><img src='{_thumb(s)}' width={THUMB_WIDTH}><br>{s.number}: {note}</figure>")
    return f"<h2>Pictures</h2>{''.join(figures)}" if figures else ""


def _thumb(sample: Sample) -> str:
    """The picture with its corners as a data URL."""
    cv2 = opencv()
    color = cv2.cvtColor(sample.gray, cv2.COLOR_GRAY2BGR)
    for u, v in sample.detection.pixels:
        cv2.circle(color, (round(u), round(v)), 5, (60, 200, 40) if sample.detection.ok else (60, 60, 230), 2)
    size = (THUMB_WIDTH, round(THUMB_WIDTH * color.shape[0] / color.shape[1]))
    small = cv2.resize(color, size, interpolation=cv2.INTER_AREA)
    encoded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1]
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode("ascii")
