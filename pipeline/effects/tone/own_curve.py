"""A person's own curve of luminance, from a file."""

from __future__ import annotations

import csv
import dataclasses
import functools
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from entoptic.pipeline.frame import FrameError

SAMPLES = 2048
"""Of a curve, evenly over its decades. Engineering choice: over ten decades a straight line between two of them leaves
the cubic of one decade by less than 1e-4."""
HEADERS = {"log10_cd_m2": False, "log10_of_adapted": True}
"""First column: absolute, or relative to the luminance that the eye is adapted to."""


@dataclasses.dataclass(frozen=True, eq=False)
class Curve:
    """Display share over the logarithm of luminance, straight between samples.

    Below the first sample the share falls in proportion to luminance, to 0 at black; above the last it stays.
    """

    first_log10: float
    step_log10: float
    shares: NDArray[np.float32]
    """(SAMPLES,), rising or level, in [0, 1]."""
    of_adapted: bool
    """Whether 0 is the adapted luminance; else it is 1 cd/m²."""

    @functools.cached_property
    def most_gain(self) -> float:
        """The largest share over luminance, the unit of luminance being that of the axis."""
        logs = self.first_log10 + self.step_log10 * np.arange(len(self.shares))
        # Between samples luminance is the lower one's at least.
        return float(np.max(np.append(self.shares[1:], self.shares[0]) / 10 ** np.append(logs[:-1], logs[0])))

    @functools.cached_property
    def steepest(self) -> float:
        """The largest change of share per natural logarithm of luminance."""
        return float(np.diff(self.shares.astype(np.float64)).max()) / (self.step_log10 * math.log(10))


@functools.cache
def read_curve(path: str) -> Curve:
    """The curve of a CSV file: a header, then rows of log10 luminance and share; PCHIP between, so never overshooting.

    Read once a process. Raises FrameError naming the file, the line and the remedy.
    """
    logs, shares, of_adapted = _rows(path)
    at = np.linspace(logs[0], logs[-1], SAMPLES)
    # Rounding may let neighbours of a level stretch fall by a unit in the last place.
    sampled = np.maximum.accumulate(np.clip(PchipInterpolator(logs, shares)(at), 0, 1)).astype(np.float32)
    return Curve(float(at[0]), float(at[1] - at[0]), sampled, of_adapted)


def _rows(path: str) -> tuple[list[float], list[float], bool]:
    try:
        with Path(path).open(encoding="utf-8-sig", newline="") as file:
            rows = [(number, row) for number, row in enumerate(csv.reader(file), 1) if any(map(str.strip, row))]
    except OSError as error:
        raise FrameError(f"tone curve {path}: {error.strerror}; give the path of a CSV file") from None
    except (UnicodeDecodeError, ValueError, csv.Error) as error:
        raise FrameError(f"tone curve {path}: cannot be read as CSV: {error}") from None
    header = [field.strip() for field in rows[0][1]] if rows else []
    if len(header) != 2 or header[0] not in HEADERS or header[1] != "share":
        raise FrameError(f"tone curve {path}: its first line must be `{',share` or `'.join(HEADERS)},share`")
    logs: list[float] = []
    shares: list[float] = []
    for number, row in rows[1:]:
        try:
            log, share = map(float, row)
        except ValueError:
            raise FrameError(f"tone curve {path}, line {number}: give two numbers, {header[0]} and share") from None
        if not (-12 <= log <= 12 and 0 <= share <= 1):
            raise FrameError(f"tone curve {path}, line {number}: {header[0]} must lie in −12…12 and share in 0…1")
        if logs and (log <= logs[-1] or share < shares[-1]):
            raise FrameError(
                f"tone curve {path}, line {number}: {header[0]} must rise from line to line, share must not fall"
            )
        logs.append(log)
        shares.append(share)
    if len(logs) < 2:
        raise FrameError(f"tone curve {path}: {len(logs)} points: give two or more")
    return logs, shares, HEADERS[header[0]]


def unit_cd_m2(curve: Curve, adapted_cd_m2: float) -> float:
    """The luminance at 0 of the axis."""
    return adapted_cd_m2 if curve.of_adapted else 1.0


def gain(
    y: Float[Array, "eye y x"],
    unit: Float[Array, "eye 1 1"],
    first_log10: Float[Array, ""],
    step_log10: Float[Array, ""],
    shares: Float[Array, "sample"],
) -> Float[Array, "eye y x"]:
    """The display's share over the scene's luminance, L_d/L; level below the curve's first point."""
    first = unit * jnp.exp(first_log10 * np.float32(math.log(10)))
    y = jnp.maximum(y, first)
    at = jnp.log(y / first) * (1 / (step_log10 * np.float32(math.log(10))))
    # The barrier keeps the logarithm apart from the look-up, which is no vector code.
    at = jax.lax.optimization_barrier(at)
    below = jnp.clip(at.astype(jnp.int32), 0, shares.shape[0] - 2)
    left, right = (shares.at[cell].get(mode="promise_in_bounds") for cell in (below, below + 1))
    return (left + (right - left) * jnp.minimum(at - below, 1)) / y


def share_at(curve: Curve, y: NDArray[np.float64], unit: float) -> NDArray[np.float64]:
    """The share that a luminance of the first point or more is shown at, in float64."""
    at = (np.log10(y / unit) - curve.first_log10) / curve.step_log10
    return np.interp(at, np.arange(len(curve.shares)), curve.shares)


def gains(
    curve: Curve, low: NDArray[np.float64], high: NDArray[np.float64], unit: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The least and the largest gain between two luminances, and the gain's largest slope there.

    Shares rise with luminance: share(low)/high and share(high)/low are bounds, sharp where the two are close.
    """
    first = unit * 10**curve.first_log10
    low, high = np.maximum(low, first), np.maximum(high, first)
    least, most = share_at(curve, low, unit), share_at(curve, high, unit)
    slope = np.maximum(curve.steepest, most) / low**2
    return least / high, np.minimum(most / low, curve.most_gain / unit), slope


def full_cd_m2(curve: Curve, unit: float) -> float:
    """The luminance from which on the display shows its peak; infinite where the curve ends below it."""
    full = np.flatnonzero(curve.shares >= 1)
    return float(unit * 10 ** (curve.first_log10 + curve.step_log10 * full[0])) if full.size else math.inf
