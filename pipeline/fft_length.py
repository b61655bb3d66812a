"""Lengths of FFTs that are fast and give the same bytes whatever else the machine does.

DUCC, which is XLA's FFT on a processor, transforms as many lines at once as a vector register holds numbers, and one by
one those that are left over of a thread's share. One complex line alone, of more than 300 samples and a multiple of the
register's numbers, it splits over the register instead, and rounds otherwise. Which lines are left over depends on the
moment: an FFT whose input is not there yet runs in XLA's own pool, and has one thread there, else it has all. So an FFT
gets lengths that DUCC never splits. Real lines it splits never.
"""

from __future__ import annotations

import functools
import platform
from typing import Literal

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


@functools.cache
def fft_length(least: int, lines: Lines) -> int:
    """The least such length of `least` or more, for lines of this kind."""
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
