"""How far labels agree with physics: a share of every shard's grasps is tried, and physics' word counts."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from evg_app.learning.labels import Kind, LabelledGrasps, WithContact
from evg_app.learning.proposals import try_all
from evg_app.simulation.state import SceneState

Check = tuple[int, int, int, int]
"""Of one grasp: kind said and found, `WithContact` said and found."""
Agreement = dict[str, tuple[int, int]]
"""For each kind of label: (agreed with physics, tried)."""


def agreement(checks: Sequence[Check]) -> Agreement:
    """For each kind of label, and for labels with contact allowed: (agreed with physics, tried)."""
    table = np.array(checks, dtype=np.int64).reshape(-1, 4)
    said, found, said_contact, found_contact = table.T
    answer = {k.name.lower(): said == k for k in Kind}
    counts = {name: (int((found[of] == said[of]).sum()), int(of.sum())) for name, of in answer.items()}
    for name, value in (("holds_with_contact", WithContact.HOLDS), ("fails_with_contact", WithContact.FAILS)):
        of = (said_contact == value) & (said == Kind.COLLISION)
        counts[name] = (int((found_contact[of] == value).sum()), int(of.sum()))
    return counts


def total(parts: Sequence[Agreement]) -> Agreement:
    """The sum over shards."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {n: (sum(p[n][0] for p in parts if n in p), sum(p[n][1] for p in parts if n in p)) for n in names}


def as_text(counts: Agreement) -> str:
    """One line for people."""
    return ", ".join(f"{name} {good}/{tried}" for name, (good, tried) in counts.items())


def verify(
    state: SceneState,
    grasps: LabelledGrasps,
    contact: NDArray[np.uint8],
    share: float,
    rng: np.random.Generator,
) -> tuple[LabelledGrasps, NDArray[np.uint8], tuple[Check, ...]]:
    """Try a share of the grasps in physics, whose word counts; and for each what was said and what was found."""
    chosen = rng.permutation(len(grasps.kind))[: round(share * len(grasps.kind))]
    tried, found = try_all(state, grasps.T_task_grasp[chosen])
    checks = tuple(
        (int(a), int(b), int(c), int(d))
        for a, b, c, d in zip(grasps.kind[chosen], tried.kind, contact[chosen], found, strict=True)
    )
    kind, width, contact = grasps.kind.copy(), grasps.width.copy(), contact.copy()
    kind[chosen], contact[chosen] = tried.kind, found
    width[chosen] = np.where(tried.kind == Kind.POSITIVE, tried.width, 0.08)
    return LabelledGrasps(grasps.T_task_grasp, kind, width, grasps.owner), contact, checks
