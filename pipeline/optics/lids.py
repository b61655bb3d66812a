"""The lids and the lashes before the pupil.

The upper lid's middle hangs `FISSURE_M` · openness above the lower lid's place in the open eye, and the pupil's centre
lies halfway: the geometry by which the tracker's side tells openness from a pupil's covered part. So a pupil of 4 mm is
touched at openness 0.7, halved at 0.5 and covered at 0.3. Below that, where the lower lid's rise matters too, a closed
eye would pass nothing, and the light through a lid is not simulated: a slit of `SLIT_M` always stays.

Lashes of the lower lid point away from the pupil, and none comes before one of 8 mm: they are not drawn.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import coverage

FISSURE_M = 10e-3
"""Height of the open lids' gap (9–11 mm in healthy adults)."""
PUPIL_HEIGHT_M = 5e-3
"""Height of the pupil's centre in it (the light reflex lies 4–5 mm below the upper lid's edge in healthy adults)."""
LOWER_RISE_M = 2e-3
"""How far the lower lid rises from open to closed. Engineering choice: it keeps clear of an 8 mm pupil until the eye is
half closed, so that the upper lid's height alone tells openness, as the tracker's side takes it to."""
CORNER_M = 14e-3
"""Distance of the lids' corners from the middle, half of a 28 mm wide fissure (27–30 mm in adults)."""
SLIT_M = 0.3e-3
"""Height of the gap between lids, over the lower pupil margin, that always stays. Engineering choice: a seventh of the
smallest pupil; no closed eye then leaves a plane without light."""
LASH_M = 8e-3
"""Length of the longest lashes; the shortest have half. Engineering choice: an upper lash has 8–12 mm, and its end
curls up and forward."""
LASH_ROOT_M = 0.08e-3
"""Width of a lash at its root; it tapers to a point. Engineering choice: a thick hair."""
LASH_GAP = 0.4
"""Share of the lid's edge that lashes leave free however many there are. Engineering choice: light always passes."""
LASH_FALL_DEG = 40.0
"""How far lashes have turned down from the horizontal in a closed eye, in proportion to closure. Engineering choice."""
LASH_FAN_DEG = 25.0
"""How far the lashes at the lids' corners lean outward; those between in proportion. Engineering choice."""
LASH_JITTER_DEG = 8.0
"""Standard deviation of a lash's lean. Engineering choice: some cross."""
LASH_POINTS = 9
"""Points along one side of a lash. Engineering choice: 8 straight pieces leave a bend of 8° a piece or less."""
STREAM = 5
"""Which random stream is the lashes', so that no other part changes it."""


def edges_m(openness: float, pupil_m: float) -> tuple[float, float]:
    """Heights of the upper and the lower lid's middle over the centre of a pupil of this diameter, in metres.

    The upper lid comes no nearer to the lower lid, or to the pupil's lower margin, than `SLIT_M`.
    """
    lower_m = LOWER_RISE_M * (1 - openness) - PUPIL_HEIGHT_M
    upper_m = FISSURE_M * openness - PUPIL_HEIGHT_M
    return max(upper_m, max(lower_m, -pupil_m / 2) + SLIT_M), lower_m


def clear_of(openness: float, pupil_m: float) -> bool:
    """Whether neither lid touches a pupil of this diameter."""
    radius_m = pupil_m / 2
    upper_m, lower_m = edges_m(openness, pupil_m)
    # Where the pupil is widest the lids have come nearest to it.
    sag = [_bend_per_m(height_m) * radius_m**2 for height_m in (upper_m, lower_m)]
    return upper_m + min(sag[0], 0) >= radius_m and lower_m + max(sag[1], 0) <= -radius_m


def shade(transmittance: Float[np.ndarray, "n n"], dx_m: float, openness: float, pupil_m: float) -> None:
    """Puts both lids before the plane, in place. Their edges are parabolas through the corners of the fissure."""
    n = transmittance.shape[0]
    upper_m, lower_m = edges_m(openness, pupil_m)
    upper = coverage.below_parabola(upper_m, _bend_per_m(upper_m), n, dx_m)
    lower = coverage.below_parabola(lower_m, _bend_per_m(lower_m), n, dx_m)
    transmittance[: upper.row] = 0
    transmittance[upper.row : upper.row + len(upper.share)] *= upper.share.astype(transmittance.dtype)
    transmittance[lower.row : lower.row + len(lower.share)] *= (1 - lower.share).astype(transmittance.dtype)
    transmittance[lower.row + len(lower.share) :] = 0


def shade_lashes(
    transmittance: Float[np.ndarray, "n n"], dx_m: float, observer: Observer, openness: float, pupil_m: float
) -> None:
    """Puts the upper lid's lashes before the plane, in place; they fall as the lid does.

    Each grows in its own stretch of the lid's edge and fills at most 1 − `LASH_GAP` of it; where lashes cross, they
    cover no more than all.
    """
    if not observer.lashes:
        return
    n = transmittance.shape[0]
    upper_m, _ = edges_m(openness, pupil_m)
    x, y = _outlines(observer, openness, upper_m)
    covered = coverage.polygons(x, y, n, dx_m)
    rows, columns = covered.share.shape
    part = transmittance[covered.row : covered.row + rows, covered.column : covered.column + columns]
    part *= (1 - covered.share).astype(transmittance.dtype)


def _bend_per_m(height_m: float) -> float:
    """Curvature term of the lid's parabola, which runs through corners at the height of the closed lids' meeting."""
    corner_m = LOWER_RISE_M - PUPIL_HEIGHT_M
    return (corner_m - height_m) / CORNER_M**2


def _outlines(
    observer: Observer, openness: float, upper_m: float
) -> tuple[Float[np.ndarray, "lash corner"], Float[np.ndarray, "lash corner"]]:
    """Corners of the lashes' outlines, x right and y down: down one side to the tip and up the other."""
    random = np.random.default_rng([observer.seed, STREAM])
    count = observer.lashes
    stretch_m = 2 * CORNER_M / count
    width_m = min(LASH_ROOT_M, stretch_m * (1 - LASH_GAP))
    root_m = (np.arange(count) + 0.5) * stretch_m - CORNER_M
    root_m += (random.random(count) - 0.5) * (stretch_m - width_m)
    length_m = LASH_M * (0.5 + 0.5 * random.random(count))
    lean = np.radians(LASH_FAN_DEG * root_m / CORNER_M + LASH_JITTER_DEG * random.standard_normal(count))
    hang_m = length_m * math.sin(math.radians(LASH_FALL_DEG) * (1 - openness))
    along = np.linspace(0, 1, LASH_POINTS)
    # Straight down at the root, more and more outward to the tip.
    sideways = (hang_m * np.tan(lean))[:, None] * along**2
    slope = 2 * np.tan(lean)[:, None] * along
    half_m = width_m / 2 * (1 - along) * np.ones((count, 1))
    across, down = half_m / np.hypot(1, slope), -half_m * slope / np.hypot(1, slope)
    x = root_m[:, None] + sideways
    y = -(upper_m + _bend_per_m(upper_m) * root_m**2)[:, None] + hang_m[:, None] * along
    # Roots lie under the lid, so that none begins short of its curved edge.
    y[:, 0] -= width_m
    return (
        np.concatenate([x + across, (x - across)[:, -2::-1]], axis=1),
        np.concatenate([y + down, (y - down)[:, -2::-1]], axis=1),
    )
