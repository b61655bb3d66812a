"""What may stand in each tile of a frame, and how much may change there: the currency in which effects state bounds.

An array of four channels, (4, rows, columns): red, green and blue, linear Rec.709, and luminance Y. Every entry holds
for all pixels of its tile. In cd/m² before tone mapping; after it relative, 1 being the display's peak.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

Change = NDArray[np.float64]
"""(4, rows, columns), 0 or more: by how much a pixel of the tile may change at most, up or down."""


@dataclasses.dataclass(frozen=True, eq=False)
class Range:
    """Least and largest value of each tile's pixels."""

    low: NDArray[np.float64]
    """(4, rows, columns), finite, 0 or more."""
    high: NDArray[np.float64]
    """(4, rows, columns), finite, `low` or more."""
    tile_px: int
    """Side of a tile."""

    def widened(self, change: Change) -> Range:
        """What may stand there after such a change."""
        return Range(np.maximum(self.low - change, 0), self.high + change, self.tile_px)

    def around(self, distance_px: int) -> Range:
        """What may stand in each tile or within so many pixels of it; beyond the frame nothing stands."""
        side = 2 * -(-distance_px // self.tile_px) + 1
        size = (1, side, side)
        return Range(
            scipy.ndimage.minimum_filter(self.low, size, mode="nearest"),
            scipy.ndimage.maximum_filter(self.high, size, mode="nearest"),
            self.tile_px,
        )


def around(change: Change, distance_px: int, tile_px: int) -> Change:
    """The largest change in each tile or within so many pixels of it."""
    side = 2 * -(-distance_px // tile_px) + 1
    return np.asarray(scipy.ndimage.maximum_filter(change, (1, side, side), mode="nearest"))
