"""Two runs side by side: is one better, and how sure is that?"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evg_app.trials.statistics import Z_95, wilson

PERMUTATIONS = 20_000
"""Random relabellings; all of them when there are fewer."""
SEED = 20260101
"""Of the relabellings."""


@dataclass(frozen=True)
class Counts:
    """Successes and trials, by round in the order they were made.

    Attributes:
        successes, trials: per round. Equal lengths.
        rounds: what names a round (seed, index); equal names in two runs are the same scene.
    """

    successes: tuple[int, ...]
    trials: tuple[int, ...]
    rounds: tuple[tuple[int, int], ...] = ()

    @property
    def k(self) -> int:
        """All successes."""
        return sum(self.successes)

    @property
    def n(self) -> int:
        """All trials."""
        return sum(self.trials)


def newcombe(k1: int, n1: int, k2: int, n2: int, z: float = Z_95) -> tuple[float, float]:
    """Interval of k1/n1 - k2/n2 from the two Wilson intervals (Newcombe 1998, method 10)."""
    p1, p2 = k1 / n1, k2 / n2
    (low1, high1), (low2, high2) = wilson(k1, n1, z), wilson(k2, n2, z)
    down, up = np.hypot(p1 - low1, high2 - p2), np.hypot(high1 - p1, p2 - low2)
    return float(p1 - p2 - down), float(p1 - p2 + up)


def fisher(k1: int, n1: int, k2: int, n2: int) -> float:
    """Two-sided p of Fisher's exact test; attempts count as independent."""
    from scipy.stats import fisher_exact  # late: importing it takes longer than all other statistics

    return float(fisher_exact([[k1, n1 - k1], [k2, n2 - k2]]).pvalue)


def rounds_differ(a: Counts, b: Counts, seed: int = SEED) -> float:
    """Two-sided p of a permutation test whose units are rounds, for rounds that are not the same scenes.

    The statistic is the difference of the rates; exact up to the random relabellings (Phipson and Smyth 2010).
    """
    s, n = np.array([*a.successes, *b.successes], float), np.array([*a.trials, *b.trials], float)
    first = len(a.trials)
    seen = abs(_difference(s[None], n[None], first)[0])
    rng = np.random.default_rng(seed)
    order = rng.permuted(np.tile(np.arange(len(s)), (PERMUTATIONS, 1)), axis=1)
    return _p(_difference(s[order], n[order], first), seen)


def paired_rounds_differ(a: Counts, b: Counts, seed: int = SEED) -> float:
    """Two-sided p of a permutation test for runs over the same scenes: each round's two results may be swapped.

    Raises:
        ValueError: the rounds are not the same.
    """
    if sorted(a.rounds) != sorted(b.rounds) or not a.rounds:
        raise ValueError("the two runs are not over the same rounds")
    place = {name: i for i, name in enumerate(b.rounds)}
    order = [place[name] for name in a.rounds]
    s = np.stack([np.array(a.successes, float), np.array(b.successes, float)[order]])
    n = np.stack([np.array(a.trials, float), np.array(b.trials, float)[order]])
    seen = abs(float(s[0].sum() / n[0].sum() - s[1].sum() / n[1].sum()))
    swap = _swaps(len(a.rounds), seed)
    s1, n1 = np.where(swap, s[1], s[0]).sum(axis=1), np.where(swap, n[1], n[0]).sum(axis=1)
    s2, n2 = s.sum() - s1, n.sum() - n1
    usable = (n1 > 0) & (n2 > 0)
    differences = s1[usable] / n1[usable] - s2[usable] / n2[usable]
    if 2 ** len(a.rounds) <= PERMUTATIONS:
        return float((abs(differences) >= seen - 1e-12).mean())
    return _p(differences, seen)


def _swaps(rounds: int, seed: int) -> NDArray[np.bool_]:
    """Which rounds to swap: every way when there are few, random ones otherwise. Shape (B, rounds)."""
    if 2**rounds <= PERMUTATIONS:
        return np.asarray((np.arange(2**rounds)[:, None] >> np.arange(rounds)[None]) & 1, dtype=np.bool_)
    return np.random.default_rng(seed).random((PERMUTATIONS, rounds)) < 0.5


def _difference(s: NDArray[np.float64], n: NDArray[np.float64], first: int) -> NDArray[np.float64]:
    """Rate of the first rounds minus rate of the others. Shapes (B, R) -> (B,)."""
    one, other = n[:, :first].sum(axis=1), n[:, first:].sum(axis=1)
    return np.asarray(s[:, :first].sum(axis=1) / np.maximum(one, 1) - s[:, first:].sum(axis=1) / np.maximum(other, 1))


def _p(differences: NDArray[np.float64], seen: float) -> float:
    """Share of relabellings at least as far apart as what was seen, which counts as one of them."""
    return float((1 + (abs(differences) >= seen - 1e-12).sum()) / (1 + len(differences)))


def same_rounds(a: Counts, b: Counts) -> bool:
    """Whether both runs went over the same scenes."""
    return bool(a.rounds) and sorted(a.rounds) == sorted(b.rounds) and len(set(a.rounds)) == len(a.rounds)
