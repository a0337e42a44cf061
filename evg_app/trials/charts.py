"""Charts as SVG text: no script, no library, sharp on paper, readable without colour."""

from collections.abc import Mapping, Sequence
from html import escape

from evg_app.trials.statistics import wilson

GOOD, BAD, INK, FAINT = "#0072b2", "#d55e00", "#222", "#ccc"
"""Okabe and Ito's blue and vermilion, which colour-blind readers tell apart."""
WIDTH = 640
"""Of every chart [px]; it scales with the page."""
LABELS = 150
"""Room for row labels [px]."""
MOST_POINTS = 400
"""A curve has at most so many points."""


def _svg(height: float, parts: Sequence[str], title: str) -> str:
    """A picture of this size, with a name for those who cannot see it."""
    head = f'<svg viewBox="0 0 {WIDTH} {height:.0f}" role="img" aria-label="{escape(title, quote=True)}">'
    return f"{head}{''.join(parts)}</svg>"


def _text(x: float, y: float, words: str, anchor: str = "start", size: int = 12) -> str:
    """A word at a place."""
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" fill="{INK}">{escape(words)}</text>'
    )


def _line(x1: float, y1: float, x2: float, y2: float, colour: str = INK, width: float = 1.0) -> str:
    """A line between two places."""
    ends = f'x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
    return f'<line {ends} stroke="{colour}" stroke-width="{width}"/>'


def _percent_axis(top: float, bottom: float, left: float, right: float) -> list[str]:
    """A scale from 0 to 100 % with its grid."""
    parts = []
    for percent in range(0, 101, 20):
        x = left + (right - left) * percent / 100
        parts += [_line(x, top, x, bottom, FAINT), _text(x, bottom + 14, f"{percent} %", "middle", 10)]
    return parts


def intervals(rows: Sequence[tuple[str, int, int]], title: str) -> str:
    """Rates with Wilson intervals, one row each: (label, k, n)."""
    left, right, step = LABELS, WIDTH - 110.0, 30.0
    bottom = step * len(rows) + 8
    parts = _percent_axis(4, bottom, left, right)
    for i, (label, k, n) in enumerate(rows):
        y = step * i + 22
        parts.append(_text(left - 8, y + 4, label, "end"))
        parts.append(_text(right + 8, y + 4, f"{k}/{n}"))
        if n:
            low, high = (left + (right - left) * end for end in wilson(k, n))
            x = left + (right - left) * k / n
            parts += [_line(low, y, high, y, GOOD, 3), _line(low, y - 5, low, y + 5), _line(high, y - 5, high, y + 5)]
            parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="5" fill="{GOOD}"/>')
    return _svg(bottom + 20, parts, title)


def running_rate(outcomes: Sequence[bool], title: str) -> str:
    """The success rate as attempts come in, with its Wilson interval as a band."""
    n, left, right, top, bottom = len(outcomes), 44.0, WIDTH - 10.0, 8.0, 178.0
    parts = []
    for percent in range(0, 101, 20):
        y = bottom - (bottom - top) * percent / 100
        parts += [_line(left, y, right, y, FAINT), _text(left - 4, y + 4, f"{percent} %", "end", 10)]
    if n:
        steps = sorted({max(round(n * i / MOST_POINTS), 1) for i in range(1, MOST_POINTS + 1)} | {1, n})
        sums, total = [], 0
        for outcome in outcomes:
            total += outcome
            sums.append(total)
        xs = [left + (right - left) * (m / n) for m in steps]
        ends = [wilson(sums[m - 1], m) for m in steps]

        def points(values: Sequence[float]) -> list[str]:
            """Corners of a line."""
            return [f"{x:.1f},{bottom - (bottom - top) * v:.1f}" for x, v in zip(xs, values, strict=True)]

        band = points([low for low, _ in ends]) + points([high for _, high in ends])[::-1]
        parts.append(f'<polygon points="{" ".join(band)}" fill="{GOOD}" opacity="0.18"/>')
        rate = " ".join(points([sums[m - 1] / m for m in steps]))
        parts.append(f'<polyline points="{rate}" fill="none" stroke="{GOOD}" stroke-width="2"/>')
    parts.append(_text((left + right) / 2, bottom + 16, f"attempts, 1 to {n}", "middle", 10))
    return _svg(bottom + 22, parts, title)


def rounds(rows: Sequence[tuple[str, Sequence[bool]]], title: str) -> str:
    """Every attempt of every round in order: filled dots succeeded, crosses failed."""
    step = 16.0
    parts = []
    for i, (label, attempts) in enumerate(rows):
        y = step * i + 12
        parts.append(_text(LABELS - 8, y + 4, label, "end", 10))
        for j, success in enumerate(attempts):
            x = LABELS + 14.0 * j + 6
            if success:
                parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{GOOD}"/>')
            else:
                parts += [
                    _line(x - 4, y - 4, x + 4, y + 4, BAD, 2),
                    _line(x - 4, y + 4, x + 4, y - 4, BAD, 2),
                ]
    return _svg(step * len(rows) + 8, parts, title)


def bars(rows: Sequence[tuple[str, float, str]], title: str, colour: str = GOOD) -> str:
    """Horizontal bars: (label, value, what is written behind it)."""
    left, right, step = 230.0, WIDTH - 160.0, 20.0
    most = max((value for _, value, _ in rows), default=0.0) or 1.0
    parts = []
    for i, (label, value, written) in enumerate(rows):
        y = step * i + 4
        width = (right - left) * value / most
        parts.append(_text(left - 8, y + 12, label, "end", 11))
        parts.append(f'<rect x="{left}" y="{y:.1f}" width="{width:.1f}" height="13" fill="{colour}"/>')
        parts.append(_text(left + width + 6, y + 12, written, size=11))
    return _svg(step * len(rows) + 8, parts, title)


def reason_bars(tree: Mapping[str, Mapping[str, object]], title: str) -> str:
    """The tree of reasons: a branch, then its leaves."""
    rows: list[tuple[str, float, str]] = []
    for branch, node in tree.items():
        rows.append((branch.upper(), float(str(node["n"])), str(node["n"])))
        leaves = node["leaves"]
        assert isinstance(leaves, Mapping)
        rows += [(_short(str(leaf)), float(n), str(n)) for leaf, n in leaves.items()]
    return bars(rows, title, BAD)


def _short(words: str, most: int = 36) -> str:
    """A text that fits beside a bar."""
    return words if len(words) <= most else words[: most - 1] + "…"
