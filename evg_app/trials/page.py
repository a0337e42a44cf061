"""The report of a run as one HTML file that needs nothing else: good on a screen, on paper, and in an archive."""

import base64
import json
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from evg_app.trials import charts
from evg_app.trials.folder import ATTEMPTS
from evg_app.trials.provenance import canonical, sha256
from evg_app.trials.report import by_rounds
from evg_app.trials.rows import LogRows, key
from evg_app.trials.statistics import rate
from evg_app.trials.summary import summarise

PICTURES = 6
"""At most so many best and so many worst attempts are shown."""
MOST_ROUNDS = 60
"""More rounds are not drawn one by one."""
SCORE_BINS = 5
"""Of the chart that holds the planner's score against what happened."""

STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.45 system-ui, "DejaVu Sans", sans-serif; color: #222; max-width: 60rem; margin: 2rem auto;
  padding: 0 1rem; background: #fff; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; } h2 { font-size: 1.15rem; margin: 1.8rem 0 .4rem;
  border-bottom: 1px solid #ccc; }
.big { display: flex; flex-wrap: wrap; gap: 1rem; } .big div { border: 1px solid #ccc; border-radius: 6px;
  padding: .6rem .9rem; flex: 1 1 12rem; } .big b { display: block; font-size: 1.5rem; }
table { border-collapse: collapse; font-size: .88rem; } td, th { padding: .15rem .7rem .15rem 0; text-align: left;
  vertical-align: top; } td.n { text-align: right; font-variant-numeric: tabular-nums; }
code { font-size: .85em; overflow-wrap: anywhere; } svg { width: 100%; max-width: 40rem; height: auto; display: block; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(15rem, 1fr)); gap: .8rem; }
figure { margin: 0; } img { width: 100%; border-radius: 4px; } figcaption { font-size: .8rem; }
.note { color: #555; font-size: .88rem; } details summary { cursor: pointer; }
@media print { body { margin: 0; max-width: none; font-size: 11px; } section, figure { break-inside: avoid; }
  .pictures { grid-template-columns: repeat(3, 1fr); } @page { size: A4; margin: 15mm; } }
"""


def page(rows: LogRows) -> str:
    """The report of a run folder as HTML."""
    facts = summarise(rows)
    first = rows.runs[0]
    config, provenance = json.loads(first["config"]), json.loads(first["provenance"])
    body = [
        _head(facts),
        _section("Result", _result(facts, rows)),
        _section("Rounds", _rounds(rows)),
        _section("Why passes failed", charts.reason_bars(facts["reason_tree"], "passes without a success by reason")),
        _section("Score of the chosen grasp against what happened", _scores(rows)),
        _section("Sensing", _sensing(facts)),
        _section("Time", _times(facts)),
        _section("Best attempts", _pictures(rows, _best(rows))),
        _section("Worst attempts: failures that the planner was surest of", _pictures(rows, _worst(rows))),
        _section("Where this comes from", _origin(facts, config, provenance)),
    ]
    title = escape(f"evg-app trials: {rows.folder.name}")
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    return (
        f'<!doctype html><html lang="en"><head>{head}<style>{STYLE}</style></head><body>{"".join(body)}</body></html>\n'
    )


def _section(title: str, content: str) -> str:
    """A titled part; without content it says so."""
    return f"<section><h2>{escape(title)}</h2>{content or '<p class=note>nothing recorded</p>'}</section>"


def _table(rows: Iterable[tuple[str, Any]], numbers: bool = False) -> str:
    """Two columns."""
    kind = ' class="n"' if numbers else ""
    cells = "".join(f"<tr><th>{escape(str(a))}</th><td{kind}>{escape(str(b))}</td></tr>" for a, b in rows)
    return f"<table>{cells}</table>"


def _head(facts: Mapping[str, Any]) -> str:
    """What was run, when, and how it ended."""
    protocol = f", protocol {escape(facts['protocol'])}" if facts["protocol"] else ""
    text = f"{escape(facts['model'])}{protocol}, {escape(facts['started_at'][:16].replace('T', ' '))} UTC"
    return f"<h1>{escape(Path(facts['run_dir']).name)}</h1><p>{text}, {escape(facts['status'])}</p>"


def _result(facts: Mapping[str, Any], rows: LogRows) -> str:
    """The rates with their intervals, as numbers and as pictures."""
    dr = "unknown" if facts["objects"] is None else rate(facts["removed"], facts["objects"])
    cards = [
        ("GSR: grasps that ended in the bin", rate(facts["successes"], facts["attempts"])),
        ("DR: objects removed", dr),
        ("picks per hour", f"{facts['picks_per_hour']:.0f}"),
    ]
    boxes = "".join(f"<div>{escape(name)}<b>{escape(value)}</b></div>" for name, value in cards)
    chart_rows = [("GSR", facts["successes"], facts["attempts"])]
    if facts["objects"] is not None:
        chart_rows.append(("DR", facts["removed"], facts["objects"]))
    notes = ["Intervals: Wilson, 95 %, attempts counted as independent."]
    if facts["gsr_rounds_ci"] is not None:
        notes.append(f"With {by_rounds(facts)}; the first is Wilson's with Student's t.")
    if facts["attempts_still_needed_for_5_percent"]:
        notes.append(f"{facts['attempts_still_needed_for_5_percent']} more attempts for +/- 5 points.")
    return (
        f'<div class="big">{boxes}</div>'
        + charts.intervals(chart_rows, "rates with 95 % intervals")
        + f'<p class="note">{escape(" ".join(notes))}</p>'
        + charts.running_rate(rows.outcomes(), "success rate as attempts came in")
    )


def _rounds(rows: LogRows) -> str:
    """A row of dots for each round."""
    names = []
    for (_, seed, index), passes in list(rows.by_round.items())[:MOST_ROUNDS]:
        names.append((f"seed {seed}, round {index}", [rows.success(p) for p in passes if p["counts"]]))
    more = len(rows.rounds) - len(names)
    note = f"<p class=note>the first {len(names)} rounds; {more} more are in the numbers above</p>" if more else ""
    return charts.rounds(names, "attempts of every round") + note


def _scores(rows: LogRows) -> str:
    """Success rate in bins of the chosen grasp's score: a calibrated planner's rate rises with it."""
    executed = [row for row in rows.passes if row["counts"] and row["score"] is not None]
    bins: list[list[int]] = [[0, 0] for _ in range(SCORE_BINS)]
    for row in executed:
        i = min(max(int(row["score"] * SCORE_BINS), 0), SCORE_BINS - 1)
        bins[i][0] += rows.success(row)
        bins[i][1] += 1
    named = [(f"score {i / SCORE_BINS:.1f} to {(i + 1) / SCORE_BINS:.1f}", k, n) for i, (k, n) in enumerate(bins) if n]
    return charts.intervals(named, "success rate by score of the chosen grasp") if named else ""


def _sensing(facts: Mapping[str, Any]) -> str:
    """Verify against the truth, and the operator against both."""
    c = facts["confusion"]
    out = ""
    if sum(c.values()):
        out += _table(
            [
                ("felt and in the bin", c["true_positive"]),
                ("felt, but not in the bin", c["false_positive"]),
                ("not felt, but in the bin", c["false_negative"]),
                ("not felt and not in the bin", c["true_negative"]),
            ],
            numbers=True,
        )
    o = facts["operator"]
    if o is not None:
        kappa = "" if o["kappa"] is None else f", kappa {o['kappa']:.2f}"
        text = f"The operator agrees with the automatic label in {rate(o['agree'], o['compared'])}{kappa}. "
        text += f"GSR of the automatic label alone: {rate(*o['gsr_automatic_counts'])}."
        out += f"<p>{escape(text)}</p>"
    return out


def _times(facts: Mapping[str, Any]) -> str:
    """Wall time by stage."""
    stages = {**facts["stage_ms"], "compute (image to trajectory)": facts["compute_ms"]}
    named = [
        (name, times["median"], f"{times['median']:.0f} ms (p95 {times['p95']:.0f})")
        for name, times in stages.items()
        if times["median"] is not None
    ]
    if not named:
        return ""
    total = f"motion {facts['motion_s']:.0f} s, computing {facts['compute_s']:.0f} s in all"
    return charts.bars(named, "median wall time of each stage") + f'<p class="note">{total}</p>'


def _best(rows: LogRows) -> list[sqlite3.Row]:
    """Successes with the highest score."""
    done = [row for row in rows.passes if row["counts"] and rows.success(row)]
    return sorted(done, key=lambda row: -(row["score"] or 0.0))[:PICTURES]


def _worst(rows: LogRows) -> list[sqlite3.Row]:
    """Failures with the highest score."""
    failed = [row for row in rows.passes if row["counts"] and not rows.success(row)]
    return sorted(failed, key=lambda row: -(row["score"] or 0.0))[:PICTURES]


def _pictures(rows: LogRows, chosen: Sequence[sqlite3.Row]) -> str:
    """Pictures of these attempts, inside the file."""
    figures = []
    for row in chosen:
        path = rows.folder / ATTEMPTS / f"{row['attempt_id']}.png"
        score = "" if row["score"] is None else f", score {row['score']:.2f}"
        what = row["failure"] or row["outcome"]
        if rows.success(row) != rows.automatic_success(row):
            what += f", but {'success' if rows.success(row) else 'failure'} in the words of the operator"
        caption = f"seed {key(row)[1]}, round {key(row)[2]}, attempt {row['attempt_index']}: {what}{score}"
        image = "<p class=note>its picture was not kept</p>"
        if path.is_file():
            data = base64.b64encode(path.read_bytes()).decode("ascii")
            image = f'<img alt="{escape(caption, quote=True)}" src="data:image/png;base64,{data}">'
        figures.append(f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>")
    return f'<div class="pictures">{"".join(figures)}</div>' if figures else ""


def _devices(devices: Mapping[str, Mapping[str, str]]) -> str:
    """What camera, arm and gripper said of themselves."""
    told = (f"{name}: {', '.join(f'{k} {v}' for k, v in facts.items())}" for name, facts in devices.items())
    return "; ".join(told) or "not asked"


def _origin(facts: Mapping[str, Any], config: Mapping[str, Any], provenance: Mapping[str, Any]) -> str:
    """Hashes, versions, and the whole configuration."""
    calibration = config.get("calibration")
    hashes = [
        ("weights sha256", facts["weights_sha256"] or "no weights"),
        ("configuration sha256", facts["config_sha256"]),
        ("calibration sha256", "simulated camera" if calibration is None else sha256(canonical(calibration))),
        ("code", provenance.get("git_commit", "unknown")),
        ("python, machine", f"{provenance.get('python', '')}, {provenance.get('platform', '')}"),
        ("command", " ".join(provenance.get("command", []))),
        ("packages", ", ".join(f"{k} {v}" for k, v in provenance.get("packages", {}).items())),
        ("devices", _devices(provenance.get("devices", {}))),
        ("log", f"schema {facts['schema_version']}, {facts['sessions']} session(s), run id {facts['run_id']}"),
    ]
    text = escape(json.dumps(config, indent=1, sort_keys=True))
    return _table(hashes) + f"<details><summary>whole configuration</summary><pre><code>{text}</code></pre></details>"
