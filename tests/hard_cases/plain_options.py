"""Effects that are off by default, said plainly: the same equations in NumPy and SciPy, float64, one eye, (3, y, x)."""

import math

import numpy as np
import scipy.ndimage
import scipy.optimize
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from entoptic.pipeline import View
from entoptic.pipeline.effects.rod_noise import RodNoise
from entoptic.pipeline.mesopic import SCOTOPIC_WEIGHTS
from entoptic.pipeline.oracles import acuity, adaptation
from entoptic.pipeline.threshold import cone_threshold_cd_m2

Reals = NDArray[np.float64]


def mesopic_share(photopic_cd_m2: float) -> float:
    """The rods' part of a white light's mesopic luminance (CIE 191, MES2): its two equations, solved for m by Brent."""
    rods = 683 / 1699

    def excess(m: float) -> float:
        scotopic = sum(SCOTOPIC_WEIGHTS) * photopic_cd_m2
        mesopic = (m * photopic_cd_m2 + (1 - m) * rods * scotopic) / (m + (1 - m) * rods)
        return float(np.clip(0.7670 + 0.3334 * math.log10(mesopic), 0, 1)) - m

    if excess(0.0) <= 0:
        return 1.0
    m = 1.0 if excess(1.0) >= 0 else scipy.optimize.brentq(excess, 0, 1, xtol=1e-15, rtol=1e-15)
    by_rods = (1 - m) * rods * sum(SCOTOPIC_WEIGHTS)
    return float(by_rods / (m + by_rods))


def krawczyk(rgb: Reals, pixels_per_deg: float, display_limit: bool) -> Reals:
    """Krawczyk's σ of each pixel, between evenly blurred frames whose σ² doubles, halved from 4 px² on."""
    y = adaptation.luminance(rgb)
    resolved = 17.25 * np.arctan(1.4 * np.log10(np.maximum(y, 1e-6)) + 0.35) + 25.72
    least_px2 = (2 / 1.86) ** 2 if display_limit else 1 / 36
    steps = np.maximum((pixels_per_deg / (1.86 * resolved)) ** 2 - least_px2, 0) / 0.25
    place = np.where(steps < 1, steps, 1 + np.log2(np.maximum(steps, 1)))
    levels = [acuity.lightness(y)]
    for rung in range(1, math.ceil(place.max()) + 1):
        if rung <= 4:
            levels.append(_even(levels[0], 0.25 * 2.0 ** (rung - 1)))
        else:
            levels.append(_even(_halved(levels[-2]), 0.5) if rung % 2 else _even(levels[-1], 1.0))
    blurred = sum(np.maximum(1 - np.abs(place - k), 0) * _enlarged(level, y.shape) for k, level in enumerate(levels))
    change = np.where(place > 0, acuity.luminance_of(np.asarray(blurred)) - y, 0)
    return np.asarray(np.maximum(rgb + change, 0))


def _even(values: Reals, variance_px2: float) -> Reals:
    radius = math.ceil(4 * math.sqrt(variance_px2))
    weights = np.exp(-(np.arange(-radius, radius + 1) ** 2) / (2 * variance_px2))
    for axis in (1, 0):
        # "reflect" repeats the edge's pixel.
        values = scipy.ndimage.correlate1d(values, weights / weights.sum(), axis, mode="reflect")
    return values


def _halved(values: Reals) -> Reals:
    padded = np.pad(values, [(0, size % 2) for size in values.shape], mode="edge")
    return np.asarray(padded.reshape(padded.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3)))


def _enlarged(values: Reals, shape: tuple[int, ...]) -> Reals:
    """Linearly between the middles of pixels, doubled step by step to the size that was halved."""
    sizes = [shape]
    while sizes[-1] != values.shape:
        sizes.append(tuple(-(-size // 2) for size in sizes[-1]))
    for height, width in reversed(sizes[:-1]):
        values = at(values, (np.arange(height) + 0.5) / 2 - 0.5, (np.arange(width) + 0.5) / 2 - 0.5)
    return values


def at(values: Reals, rows: Reals, columns: Reals) -> Reals:
    """Bilinear at rows and columns, level beyond the edge."""
    places = np.meshgrid(rows, columns, indexing="ij")
    return np.asarray(scipy.ndimage.map_coordinates(values, places, order=1, mode="nearest"))


def rod_noise(
    rgb: Reals, elapsed_s: float, pupil_diameter_mm: float, pixels_per_deg: float, settings: RodNoise
) -> Reals:
    """Counts of light and heat with a variance of their own, by Anscombe's root; drawn by the same hash."""
    slot, fraction = divmod(elapsed_s / 0.1, 1.0)
    grain_px = max(1, round(settings.grain_deg * pixels_per_deg))
    _, height, width = rgb.shape
    grid = (-(-height // grain_px) + 1, -(-width // grain_px) + 1)
    early, late = (_drawn(grid, int(slot) + k, settings.seed) for k in (0, 1))
    noise = _between(early, late, fraction)
    for size in (height, width):
        place = np.arange(size) / grain_px
        low = place.astype(int)
        noise = _between(noise[low], noise[low + 1], (place - low)[:, None]).T
    rods = 7000 * settings.grain_deg**2
    per_scotopic, thermal = rods * 0.1 * 8.6 * math.pi / 4 * pupil_diameter_mm**2, rods * 0.1 / 160
    events = per_scotopic * np.einsum("c,cyx->yx", SCOTOPIC_WEIGHTS, rgb) + thermal
    counted = (noise / 2 + np.sqrt(events - 0.25)) ** 2
    fade = np.clip(1 - adaptation.luminance(rgb) / settings.below_cd_m2, 0, 1)
    own = fade * thermal / (per_scotopic * sum(SCOTOPIC_WEIGHTS)) if settings.own_light else 0.0
    return np.asarray((rgb + own) * (1 + fade * (counted / events - 1)))


def _between(before: Reals, after: Reals, share: float | Reals) -> Reals:
    """Variance stays 1."""
    return np.asarray((before * (1 - share) + after * share) / np.sqrt((1 - share) ** 2 + share**2))


def _drawn(grid: tuple[int, int], slot: int, seed: int) -> Reals:
    """Sums of a hash's two halves, of mean 0 and variance 1."""
    index = np.arange(math.prod(grid), dtype=np.uint64).reshape(grid)
    bits = _mixed(index ^ _mixed(np.array([slot], np.uint64) ^ _mixed(np.array([seed], np.uint64))))
    total = (bits & np.uint64(0xFFFF)) + (bits >> np.uint64(16))
    return (total.astype(np.float64) - 65535) * math.sqrt(6 / (65536**2 - 1))


def _mixed(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """`lowbias32` (Wellons 2018), in the lower half of 64 bits."""
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B), (16, 1)):
        bits = ((bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)) & np.uint64(0xFFFFFFFF)
    return bits


CONES_OF_XYZ = np.array([[0.40024, 0.70760, -0.08081], [-0.22630, 1.16532, 0.04570], [0.0, 0.0, 0.91822]])
"""Hunt, Pointer and Estévez."""


def cones() -> Reals:
    """L, M and S of linear Rec.709, each 1 for white."""
    xy = np.array([[0.640, 0.330], [0.300, 0.600], [0.150, 0.060], [0.3127, 0.3290]])
    columns = np.stack([xy[:, 0] / xy[:, 1], np.ones(4), (1 - xy.sum(axis=1)) / xy[:, 1]])
    of_rgb = CONES_OF_XYZ @ columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])
    return np.asarray(of_rgb / of_rgb.sum(axis=1, keepdims=True))


def bleached(
    rgb: Reals, view: View, gaze_px: tuple[float, float], pupil_diameter_mm: float, dt_s: float, count: int
) -> Reals:
    """Of a rested retina after so long before a frame: Rushton's exponential, over a map of count² cells of ±75°."""
    deg = np.linspace(-75, 75, count)
    right, up = np.meshgrid(deg, -deg)
    off = np.hypot(right, up)
    share = np.sin(np.radians(off)) / np.maximum(off, 1e-30)
    share[off == 0] = math.radians(1)
    x, y, z = np.einsum("ij,jyx->iyx", _turn(view, gaze_px), [right * share, up * share, np.cos(np.radians(off))])
    column_px = view.width_px / 2 + view.focal_px * x / np.maximum(z, 1e-3)
    row_px = view.height_px / 2 - view.focal_px * y / np.maximum(z, 1e-3)
    edge = 0.05 * max(view.width_px, view.height_px)
    lit = (z > 1e-3) & (np.abs(column_px - view.width_px / 2) < view.width_px / 2 + edge)
    lit &= np.abs(row_px - view.height_px / 2) < view.height_px / 2 + edge
    down, across = _node_px(view)
    nodes = np.add.reduceat(rgb, np.arange(0, view.height_px, down), axis=1)
    nodes = np.add.reduceat(nodes, np.arange(0, view.width_px, across), axis=2)
    counts = np.add.reduceat(np.ones(view.height_px), np.arange(0, view.height_px, down))[:, None]
    counts = counts * np.add.reduceat(np.ones(view.width_px), np.arange(0, view.width_px, across))
    catches = np.einsum("cj,jyx->cyx", cones(), nodes / counts)
    places = np.stack([row_px / down - 0.5, column_px / across - 0.5])
    light = np.stack([scipy.ndimage.map_coordinates(one, places, order=1, mode="nearest") for one in catches])
    relative = np.maximum(light, 0) * lit * math.pi / 4 * pupil_diameter_mm**2 / 10**4.3
    return np.asarray(relative / (1 + relative) * -np.expm1(-dt_s * (1 + relative) / 110))


def with_afterimage(
    displayed: Reals, bleached_: Reals, exposure: float, view: View, gaze_px: tuple[float, float]
) -> Reals:
    """A displayed frame before a retina so bleached: what cones see less of it, and the light of their own."""
    down, across = _node_px(view)
    rows, columns = (np.arange(-(-size // side)) for size, side in ((view.height_px, down), (view.width_px, across)))
    up = (view.height_px / 2 - down * (rows + 0.5)) / view.focal_px
    right = (across * (columns + 0.5) - view.width_px / 2) / view.focal_px
    ahead = 1 / np.sqrt(1 + right[None, :] ** 2 + up[:, None] ** 2)
    x, y, z = np.einsum("ji,jyx->iyx", _turn(view, gaze_px), [right[None, :] * ahead, up[:, None] * ahead, ahead])
    off = np.hypot(x, y)
    cells = np.degrees(np.arctan2(off, z)) / np.maximum(off, 1e-30) * (bleached_.shape[1] - 1) / 150
    middle = (bleached_.shape[1] - 1) / 2
    places = np.stack([middle - y * cells, middle + x * cells])
    there = np.stack([scipy.ndimage.map_coordinates(one, places, order=1, mode="nearest") for one in bleached_])
    field = there.mean(axis=(1, 2), keepdims=True)
    dark_cd_m2 = cone_threshold_cd_m2(0.0) / (cone_threshold_cd_m2(1e4) / 1e4)
    own = dark_cd_m2 * np.maximum(10 ** (3 * there) - 10 ** (3 * field), 0)
    to_rgb = np.linalg.inv(cones())
    light = -np.expm1(-np.maximum(np.einsum("kc,cyx->kyx", to_rgb, own), 0) * exposure * 0.1)
    rows_px = (np.arange(view.height_px) + 0.5) / down - 0.5
    columns_px = (np.arange(view.width_px) + 0.5) / across - 0.5
    less, light = (
        np.stack([at(one, rows_px, columns_px) for one in layer]) for layer in ((field - there) / (1 - field), light)
    )
    more = np.einsum("kc,cyx->kyx", to_rgb, less * np.einsum("cj,jyx->cyx", cones(), displayed))
    changed = displayed + (1 - displayed**2) * more
    return np.asarray(changed + light * (1 - changed))


def _turn(view: View, gaze_px: tuple[float, float]) -> Reals:
    """From straight ahead to this pixel about one axis (Listing)."""
    gaze = np.array([gaze_px[0] - view.width_px / 2, view.height_px / 2 - gaze_px[1], view.focal_px])
    gaze /= np.linalg.norm(gaze)
    axis = np.cross([0, 0, 1], gaze)
    size = np.linalg.norm(axis)
    angle = math.atan2(size, gaze[2])
    return np.asarray(Rotation.from_rotvec(axis * (angle / size if size else 0)).as_matrix())


def _node_px(view: View) -> tuple[int, int]:
    """At most 128 nodes along the longer side; a little coarser if that leaves no rest."""
    least = -(-max(view.width_px, view.height_px) // 128)
    sides = [
        next((side for side in range(least, least * 3 // 2 + 1) if size % side == 0), least)
        for size in (view.height_px, view.width_px)
    ]
    return sides[0], sides[1]
