"""How often the intervals hold the truth: `python tests/trials/coverage.py > docs/results/trials_coverage.json`."""

import json
import sys
from unittest.mock import patch

import numpy as np
from scipy.stats import binom

from evg_app.trials import bootstrap
from evg_app.trials.sequential import attempts_differ
from evg_app.trials.statistics import wilson

RUNS = 2000


def wilson_grid() -> dict[str, object]:
    """Exact coverage, summed over all outcomes."""
    found = []
    for n in (20, 45, 79, 150, 300):
        ends = np.array([wilson(k, n) for k in range(n + 1)])
        for p in np.linspace(0.05, 0.99, 48):
            inside = (ends[:, 0] <= p) & (p <= ends[:, 1])
            found.append(float(binom.pmf(np.arange(n + 1), n, p)[inside].sum()))
    return {"mean": float(np.mean(found)), "least": min(found), "cells": len(found)}


def clustered(rounds: int, rate: float, spread: float) -> dict[str, float]:
    """Coverage of bootstrap and Wilson when rounds of 3 to 8 attempts have beta-distributed rates."""
    rng, hits = np.random.default_rng(rounds), np.zeros(2)
    a, b = rate * (1 - spread) / spread, (1 - rate) * (1 - spread) / spread
    for i in range(RUNS):
        trials = rng.integers(3, 9, rounds)
        s = rng.binomial(trials, rng.beta(a, b, rounds))
        interval = bootstrap.cluster_bootstrap(s, trials, seed=i) or (0.0, 1.0)
        own = wilson(int(s.sum()), int(trials.sum()))
        hits += [interval[0] <= rate <= interval[1], own[0] <= rate <= own[1]]
    return {"rounds": rounds, "rate": rate, "spread": spread, "bootstrap": hits[0] / RUNS, "wilson": hits[1] / RUNS}


def false_alarms(rate: float, looks: int) -> float:
    """Share of runs with equal rates that the sequential test ever calls different, looking after every attempt."""
    rng = np.random.default_rng(0)
    return sum(attempts_differ(*(rng.random((2, looks)) < rate)).decided_at is not None for _ in range(RUNS)) / RUNS


if __name__ == "__main__":
    with patch.object(bootstrap, "DRAWS", 1000):
        rows = [clustered(n, rate, spread) for n in (15, 50, 200) for rate in (0.8, 0.9) for spread in (0.05, 0.3)]
    alarms = {str(rate): false_alarms(rate, 400) for rate in (0.5, 0.8, 0.95)}
    facts = {"wilson_grid": wilson_grid(), "clustered": rows, "sequential_false_alarms": alarms, "runs": RUNS}
    sys.stdout.write(json.dumps(facts, indent=1) + "\n")
