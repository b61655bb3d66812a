"""How many threads compute: as many as the machine has cores, however many of them this process may use.

What XLA compiles rounds otherwise for another number: it divides a loop's work by it, and LLVM then contracts other
products and sums into one instruction; YNNPACK adds up in another order where there is more than one thread. XLA itself
would take the cores that a process may use, so that one in a container or under `taskset` would give other bytes.
"""

from __future__ import annotations

import os

THREADS = "PJRT_NPROC"
"""The environment variable that tells XLA how many threads to start."""


def fix_threads() -> int:
    """Has XLA start that many unless the environment says how many; returns the number.

    To be called before JAX computes anything.
    """
    return int(os.environ.setdefault(THREADS, str(os.cpu_count() or 1)))
