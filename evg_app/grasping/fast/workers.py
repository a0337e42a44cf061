"""Threads that share the pieces of a plan."""

import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import TypeVar

import torch

Piece = TypeVar("Piece")
Answer = TypeVar("Answer")


class Workers:
    """Runs a function on pieces of work, each thread taking the next piece when it is done with one.

    A thread whose core is busy with something else takes fewer pieces. What is computed does not depend on how many
    threads there are. Torch's own operations stay on the thread that calls them. (Setting torch's number of threads
    is not for each plan: it makes a pool whose threads spin for 60 ms.)

    Args:
        threads: how many; with one the caller does the work.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._pool: ThreadPoolExecutor | None = None

    def map(self, function: Callable[[Piece], Answer], pieces: Sequence[Piece]) -> list[Answer]:
        """The function's answers in the order of the pieces."""
        answers: dict[int, Answer] = {}
        numbers = itertools.count()  # next() of it is atomic

        def drain() -> None:
            """Take pieces until none is left."""
            with torch.inference_mode():
                while (number := next(numbers)) < len(pieces):
                    answers[number] = function(pieces[number])

        if self.threads == 1 or len(pieces) < 2:
            drain()
        else:
            pool = self._started()
            for future in [pool.submit(drain) for _ in range(min(self.threads, len(pieces)))]:
                future.result()
        return [answers[number] for number in range(len(pieces))]

    def _started(self) -> ThreadPoolExecutor:
        """The threads, all running, torch set to one thread in each; the caller's setting stays."""
        if self._pool is None:
            pool, before = ThreadPoolExecutor(self.threads, "evg-plan"), torch.get_num_threads()
            together = Barrier(self.threads)

            def settle() -> None:
                """Once in each thread. Asking first matters: the first use of torch in a thread sets its number."""
                together.wait()
                torch.get_num_threads()
                torch.set_num_threads(1)

            for future in [pool.submit(settle) for _ in range(self.threads)]:
                future.result()
            torch.set_num_threads(before)
            self._pool = pool
        return self._pool


def pieces(count: int, largest: int) -> list[slice]:
    """Slices that cover `count` items: an even number of them, about equally long, none above `largest`."""
    number = max(1, 2 * -(-count // (2 * largest))) if count > 1 else count
    bounds = [round(i * count / number) for i in range(number + 1)] if count else [0]
    return [slice(a, b) for a, b in itertools.pairwise(bounds)]
