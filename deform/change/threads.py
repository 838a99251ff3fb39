"""Work that does not hold the interpreter's lock in, the same done on the cores that this process may use out."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np

_MOST = 2  # cores: each pair of runs that is searched at a time takes memory, some 0.2 GB on a line of 100 km
_LEAST_PLACES = 1_000_000  # of an array, for each core to be worth its thread


def cores() -> int:
    """Return on how many cores pairs of runs are searched at a time."""
    able = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(able, _MOST))


def in_parts(size: int, work: Callable[[int, int], Any]) -> None:
    """Do the work from each first place to before each last one, together all of an array of so many places."""
    parts = max(min(cores(), size // _LEAST_PLACES), 1)
    edges = [int(edge) for edge in np.linspace(0, size, parts + 1)]
    if parts == 1:
        work(0, size)
        return
    with ThreadPoolExecutor(parts) as pool:
        for done in [pool.submit(work, first, last) for first, last in pairwise(edges)]:
            done.result()
