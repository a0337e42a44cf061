"""What is written beside the picture, as small pieces of HTML."""

from collections.abc import Mapping, Sequence
from html import escape

from evg_app.types import Verdict
from evg_app.viewer.colors import VERDICT_COLORS

LABELS = {"success": True, "failure": False, "cannot tell": None}
"""What a person may say about a pass, in words and as it is kept."""
FONT = "font: 13px/1.4 system-ui, sans-serif; padding: 0.2em 0.8em"


def lines(texts: Sequence[str]) -> str:
    """One line each, the first one bold."""
    first, rest = (texts[0], texts[1:]) if texts else ("", ())
    return f'<div style="{FONT}"><b>{escape(first)}</b>{"".join(f"<br>{escape(text)}" for text in rest)}</div>'


def legend(verdicts: Mapping[str, int]) -> str:
    """The verdicts that occur, with their colours and how many candidates have them."""
    if not verdicts:
        return f'<div style="{FONT}">no candidate</div>'
    rows = "".join(
        f'<div><span style="color: rgb{VERDICT_COLORS[Verdict(word)]}">&#9632;</span> {escape(word)}: {n}</div>'
        for word, n in verdicts.items()
    )
    return f'<div style="{FONT}">{rows}</div>'


def attempt(seed: int, round_index: int, index: int, outcome: str, failure: str) -> list[str]:
    """What an attempt was, and how it ended."""
    what = f"seed {seed}, round {round_index}, pass {index}"
    return [what, f"{outcome}{f': {failure}' if failure else ''}"]
