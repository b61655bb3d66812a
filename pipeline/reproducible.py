"""The same bytes on a machine, however many of its cores a process may use and whatever else it does.

**Threads.** What XLA compiles rounds otherwise for another number of threads: it divides a loop's work by them, and
LLVM then contracts other products and sums into one instruction; YNNPACK adds up in another order where there is more
than one. XLA would take as many threads as a process may use cores. `fix_threads` makes that all of the machine's.

**FFTs.** DUCC transforms as many lines at once as a vector register holds numbers, and one by one those that are left
over of a thread's share. One complex line alone, of more than 300 samples and a multiple of the register's numbers, it
splits over the register instead, and rounds otherwise. Which lines are left over depends on the moment: where XLA runs
an FFT in its own pool, as it does when the input is not there yet, it has one thread. So an FFT is given lengths that
DUCC never splits: `fast_length`. Real lines it splits never.
"""

from __future__ import annotations

import functools
import os
import platform
from typing import Literal

THREADS = "PJRT_NPROC"
"""The environment variable that tells XLA how many threads to start."""

Lines = Literal["real", "complex64", "complex128"]
"""Of an FFT. In that of a real image in two dimensions, lines along the last axis are real, those across complex."""
IN_REGISTER: dict[Lines, int] = {
    "complex64": 8 if platform.machine() in ("x86_64", "AMD64") else 4,
    "complex128": 4,
}
"""Numbers of a register, as jaxlib is built: AVX on x86-64, Neon elsewhere."""
SPLIT_ABOVE = 300
"""Samples of a line up to which DUCC splits none."""
FACTORS = (2, 3, 5, 7, 11)
"""Those for which DUCC has code of its own."""


def fix_threads() -> None:
    """Has XLA start as many threads as the machine has cores, unless the environment says how many.

    To be called before JAX computes anything.
    """
    os.environ.setdefault(THREADS, str(os.cpu_count() or 1))


@functools.cache
def fast_length(least: int, lines: Lines) -> int:
    """The least length of `least` or more for which an FFT of such lines is fast and always gives the same bytes."""
    split = IN_REGISTER.get(lines)
    length = max(least, 1)
    while not _has_small_factors(length) or (split and length > SPLIT_ABOVE and length % split == 0):
        length += 1
    return length


def _has_small_factors(length: int) -> bool:
    """And no others."""
    for factor in FACTORS:
        while length % factor == 0:
            length //= factor
    return length == 1
