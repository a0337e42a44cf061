"""How often the intervals hold the truth: `python tests/trials/coverage.py > docs/results/trials_coverage.json`."""

import json
import sys
from collections.abc import Callable
from itertools import product
from unittest.mock import patch

import numpy as np
from scipy.stats import binom

from evg_app.trials import bootstrap
from evg_app.trials import rounds as rounds_
from evg_app.trials.sequential import attempts_differ
from evg_app.trials.statistics import wilson

RUNS = 500
Draw = Callable[[np.random.Generator, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Plays rounds of given success rates; successes and attempts of each."""


def wilson_grid() -> dict[str, object]:
    """Exact coverage, summed over all outcomes."""
    found = []
    for n in (20, 45, 79, 150, 300):
        ends = np.array([wilson(k, n) for k in range(n + 1)])
        for p in np.linspace(0.05, 0.99, 48):
            inside = (ends[:, 0] <= p) & (p <= ends[:, 1])
            found.append(float(binom.pmf(np.arange(n + 1), n, p)[inside].sum()))
    return {"mean": float(np.mean(found)), "least": min(found), "cells": len(found)}


def alike(rng: np.random.Generator, rate: float, spread: float, shape: tuple[int, ...]) -> np.ndarray:
    """Success rates of rounds: beta-distributed, `spread` is the correlation of attempts within a round."""
    if not spread:
        return np.full(shape, rate)
    return rng.beta(rate * (1 - spread) / spread, (1 - rate) * (1 - spread) / spread, shape)


def free(rng: np.random.Generator, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Successes and attempts of rounds of 3 to 8 attempts."""
    trials = rng.integers(3, 9, p.shape)
    return rng.binomial(trials, p), trials


def declutter(rng: np.random.Generator, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Successes and attempts of rounds of five objects that end when cleared or after two failures in a row."""
    s, n, failed, on = np.zeros(p.shape, int), np.zeros(p.shape, int), np.zeros(p.shape, int), np.ones(p.shape, bool)
    while on.any():
        hit = (rng.random(p.shape) < p) & on
        n, s = n + on, s + hit
        failed = np.where(hit, 0, failed + on)
        on = on & (failed < 2) & (s < 5)
    return s, n


def coverage(draw: Draw, rounds: int, rate: float, spread: float) -> dict[str, object]:
    """How often the intervals hold the rate that very many rounds would have."""
    rng = np.random.default_rng([rounds, int(100 * rate), int(100 * spread)])
    many = draw(rng, alike(rng, rate, spread, (1_000_000,)))
    truth = many[0].sum() / many[1].sum()
    hits, lengths = np.zeros(3), np.zeros(3)
    for i in range(RUNS):
        s, n = draw(rng, alike(rng, rate, spread, (rounds,)))
        found = (
            rounds_.round_interval(s, n) or (0.0, 1.0),
            bootstrap.cluster_bootstrap(s, n, seed=i) or (0.0, 1.0),
            wilson(int(s.sum()), int(n.sum())),
        )
        hits += [low <= truth <= high for low, high in found]
        lengths += [high - low for low, high in found]
    names = ("by_rounds", "bootstrap", "wilson")
    facts: dict[str, object] = {"rounds_of": draw.__name__, "rounds": rounds, "rate": rate, "correlation": spread}
    facts |= {"truth": float(truth)} | dict(zip(names, (hits / RUNS).tolist(), strict=True))
    return facts | {"length": dict(zip(names, (lengths / RUNS).round(4).tolist(), strict=True))}


def means(rows: list[dict[str, object]]) -> list[dict[str, object]]:
    """Over rates and correlations, for each kind and number of rounds; least over single cells."""
    out = []
    for kind, number in sorted({(str(r["rounds_of"]), int(str(r["rounds"]))) for r in rows}):
        cells = [r for r in rows if (r["rounds_of"], r["rounds"]) == (kind, number)]
        found = {name: [float(str(r[name])) for r in cells] for name in ("by_rounds", "bootstrap", "wilson")}
        stats = {name: {"mean": float(np.mean(c)), "least": min(c), "most": max(c)} for name, c in found.items()}
        out.append({"rounds_of": kind, "rounds": number, "cells": len(cells), **stats})
    return out


def false_alarms(rate: float, looks: int) -> float:
    """Share of runs with equal rates that the sequential test ever calls different, looking after every attempt."""
    rng = np.random.default_rng(0)
    return sum(attempts_differ(*(rng.random((2, looks)) < rate)).decided_at is not None for _ in range(RUNS)) / RUNS


def _cell(words: tuple[Draw, int, float, float]) -> dict[str, object]:
    """One cell, with fewer bootstrap samples."""
    with patch.object(bootstrap, "DRAWS", 1000):
        return coverage(*words)


if __name__ == "__main__":
    kinds, sizes, spreads = (free, declutter), (15, 50, 200), (0.0, 0.05, 0.3)
    cells = list(product(kinds, sizes, (0.5, 0.7, 0.8, 0.9, 0.95), spreads))
    rows = [_cell(cell) for cell in cells]
    alarms = {str(rate): false_alarms(rate, 400) for rate in (0.5, 0.8, 0.95)}
    facts = {"wilson_grid": wilson_grid(), "means": means(rows), "cells": rows, "sequential_false_alarms": alarms}
    sys.stdout.write(json.dumps({**facts, "runs": RUNS}, indent=1) + "\n")
