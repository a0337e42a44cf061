"""A few threads that share a list of pieces of work: no barrier in every operation, and nobody spins while waiting."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

import torch

Piece = TypeVar("Piece")
Answer = TypeVar("Answer")


class Workers:
    """Runs a function on pieces of work, each thread taking the next piece when it is done with one.

    A thread whose core is busy with something else takes fewer pieces. What is computed does not depend on how many
    threads there are.

    Args:
        threads: how many, the caller's included.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool: ThreadPoolExecutor | None = None

    def map(self, function: Callable[[Piece], Answer], pieces: Sequence[Piece]) -> list[Answer]:
        """The function's answers in the order of the pieces."""
        answers: dict[int, Answer] = {}
        numbers = itertools.count()  # next() of it is atomic

        def drain() -> None:
            with torch.inference_mode(), one_torch_thread():
                while (number := next(numbers)) < len(pieces):
                    answers[number] = function(pieces[number])

        helpers = min(self.threads, len(pieces)) - 1
        if helpers > 0 and self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads - 1, "evg-plan")
        futures = [self._pool.submit(drain) for _ in range(helpers)] if self._pool is not None else []
        drain()
        for future in futures:
            future.result()
        return [answers[number] for number in range(len(pieces))]


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Torch's own operations stay on the calling thread meanwhile."""
    before = torch.get_num_threads()
    if before == 1:
        yield
        return
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def pieces(count: int, largest: int) -> list[slice]:
    """Slices that cover `count` items: an even number of them, about equally long, none above `largest`."""
    number = max(1, 2 * -(-count // (2 * largest))) if count > 1 else count
    bounds = [round(i * count / number) for i in range(number + 1)] if count else [0]
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]
