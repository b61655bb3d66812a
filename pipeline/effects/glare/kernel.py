"""The eye's point-spread function as models give it, and what it becomes in a view's plane.

A function is a mixture of prepared parts with weights: of two pupils on either side of the one that is seen with, or of
the terms of a formula whose weights follow adaptation. So neither a pupil in motion nor an eye that adapts needs a new
function for each frame.

Light is scattered by where it lands. Beyond some cells of the plane it is far: smooth, and convolved in the plane. What
is nearer is laid down at true angles around the pixels that stand out (stamps.py); of all the others it is scattered
in the plane and over a few pixels of the finer levels (pyramid.py), each from where the one before leaves off.

**Scales.** An angle θ is a distance d in the plane times c₁·c₂ = g. So K(θ) has no one shape in the plane. It is taken
as g^−FALLS·(A(d) + g^TURNS·B(d)), exact where g is the largest that two directions this far apart can have and where
it is the least of the view, and close in between, since glare falls as a power of the angle: from θ^−2.7 near the axis
to θ^−1.5 far off. c₁ and c₂ then weigh the light that goes to the plane and what comes back.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy.fft
from jaxtyping import Array, Complex, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare.plane import Plane
from entoptic.pipeline.effects.glare.pyramid import NEXT, WIDER, Stencil, around
from entoptic.pipeline.optics import radial, whole

FALLS, TURNS = 2.8, 1.2
"""Powers of the angle between which glare's falls: θ^−2.8 and θ^−1.6. Engineering choice: with them the least errors
over the whole view (docs/decisions/0018-glare-on-the-sphere.md)."""
FAR_CELLS = (0.5, 5.0)
"""Cells of the plane between which what is near gives way to what is far. Engineering choice: a rise that quadratic
B-splines follow within 3 %."""
FIRST_PX, THEN = (1.0, 2.2), 3.1
"""Pixels between which the finest level gives way to the next, and how much wider each level is than the one before.
Engineering choice: within the reach of 3 × 3 pixels, and of 7 × 7 at the coarser ones."""
GAIN = 3.0
"""How far what the B-splines flatten is raised again, at most. Engineering choice: more raises what they alias."""
FINE_PER_PX, CORE_PER_PX, CORE_PX = 3, 12, 3
"""Samples along a pixel of what is near, and within CORE_PX of the axis."""
DEGREE, ROWS = 3, 12
"""Of the polynomials in sin²α that the levels' weights are, and at how many places they are fitted. Engineering choice:
within 1 % out to 65°; a narrow view needs fewer powers."""

Formula = Callable[..., NDArray[np.float64]]
"""One of analytic.py's densities: of the angle in degrees and its parameters."""
Cells = Callable[[float, int, float], NDArray[np.float64]]
"""Of cells per degree, a radius in cells and how many times further out the veil begins: the light of a point in each
cell around it, (o, i, k, k) from channel i to channel o or (1, 1, k, k) where all are alike, without the veil's."""
Reals = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Veil:
    """Light that an analytic function scatters further than a part's cells reach; it has the colour of its source."""

    function: Formula
    parameters: tuple[float, ...] = ()

    def density(self, deg: Reals, wider: float) -> Reals:
        """Per steradian, at an angle; 0 beyond 90°."""
        inside = deg <= radial.EDGE_DEG
        return np.where(inside, self.function(deg, *self.parameters) * whole.veil_part(deg, wider), 0)


class Mixed(NamedTuple):
    """What of a part is small."""

    all_near: Float[Array, "o i"]
    """Light that does not go far."""
    stays: Float[Array, "o i"]
    """Light that the plane leaves to a pixel; the levels take theirs of it."""
    taps: tuple[Float[Array, "tap power o"], ...]
    """Of each level, finest first: the weights of its stencil's taps as polynomials of sin²α."""
    leaves: Float[Array, "power o"]
    """All that the levels take."""


class Sampled(NamedTuple):
    """Density of what is near, sr⁻¹."""

    fine: Float[Array, "o i k k"]
    """FINE_PER_PX samples a pixel of the middle."""
    core: Float[Array, "o i j j"]
    """CORE_PER_PX samples a pixel, CORE_PX pixels to each side."""


class Prepared(NamedTuple):
    """A part in a view's plane; weighted sums of these are what a mixture is there."""

    high: Complex[Array, "o i v u"]
    """Transform of A, and of B."""
    turning: Complex[Array, "o i v u"]
    near: Complex[Array, "o i v u"] | None
    """Of what is near and beyond the levels, for pixels that do not stand out."""
    sampled: Sampled
    mixed: Mixed


@dataclasses.dataclass(frozen=True, eq=False)
class Part:
    """One prepared function."""

    cells: Cells
    veil: Veil | None
    colour: Reals | None = None
    """Linear Rec.709 of a light with a spectrum of its own, of luminance 1: the colour of its veil."""
    made: dict[Any, Any] = dataclasses.field(default_factory=dict, repr=False)
    """What was made of it, by what for: it goes when the part goes."""

    def kept(self, what: Any, make: Callable[[], Any]) -> Any:
        """What was made of it, made now if it was not."""
        if what not in self.made:
            self.made[what] = make()
        return self.made[what]


Mixture = tuple[tuple[Part, float], ...]
"""A point-spread function: parts and their weights, which add up to 1."""


def levels(plane: Plane) -> tuple[Stencil, ...]:
    """The stencils of the levels from the pixels up to the plane's cells, finest first."""
    return (NEXT, *(WIDER for _ in range(plane.pool.bit_length() - 1)))


def far_deg(plane: Plane) -> tuple[float, float]:
    """Angles between which what is near gives way to what is far."""
    return FAR_CELLS[0] * plane.step_deg, FAR_CELLS[1] * plane.step_deg


def prepared(mixture: Mixture, plane: Plane) -> list[tuple[Prepared, float]]:
    """Each part in a plane, and its weight."""
    return [(part.kept(("plane", plane), functools.partial(_prepare, part, plane)), weight) for part, weight in mixture]


def smooth_step(x: Reals, low: float, high: float) -> Reals:
    """0 below `low`, 1 above `high`, with level and straight ends between."""
    position = np.clip((x - low) / (high - low), 0, 1)
    return position**3 * (10 - 15 * position + 6 * position * position)


def _prepare(part: Part, plane: Plane) -> Prepared:
    far = far_deg(plane)
    wider = max(1.0, far[1] / whole.VEIL_DEG[0])
    pixel_deg = plane.step_deg / plane.pool
    fine, fine_deg = near_cells(part, pixel_deg / FINE_PER_PX, far, wider)
    all_near = fine.sum(axis=(2, 3))
    bounds = [tuple(pixel_deg * edge * THEN**k for edge in FIRST_PX) for k in range(len(levels(plane)))]
    near, near_deg = near_cells(part, plane.step_deg / 3, far, wider)
    near = _threes(near * smooth_step(near_deg, *bounds[-1])) if plane.pool == 1 else np.zeros((1, 1, 1, 1))
    core, core_deg = core_cells(part, pixel_deg / CORE_PER_PX, far, wider)
    profile = profile_of(pixel_deg, core, core_deg, fine, fine_deg, far[1])
    taps = [taps_of(profile, plane, k, stencil, bounds) for k, stencil in enumerate(levels(plane))]
    leaves = sum(
        len(around(tap)) * of_tap
        for stencil, of_level in zip(levels(plane), taps, strict=True)
        for tap, of_tap in zip(stencil, of_level, strict=True)
    )
    high, turning = _far(part, plane, wider)
    return Prepared(
        high,
        turning,
        transform(_at_origin(near / plane.step**2, plane), plane, 1.0) if plane.pool == 1 else None,
        Sampled(
            *(
                jax.device_put(np.float32(cells / np.radians(pixel_deg / per_px) ** 2))
                for cells, per_px in ((fine, FINE_PER_PX), (core, CORE_PER_PX))
            )
        ),
        Mixed(
            jax.device_put(np.float32(all_near)),
            jax.device_put(np.float32(all_near - near.sum(axis=(2, 3)))),
            tuple(jax.device_put(np.float32(of_level)) for of_level in taps),
            jax.device_put(np.float32(leaves)),
        ),
    )


def near_cells(part: Part, side_deg: float, far: tuple[float, float], wider: float) -> tuple[Reals, Reals]:
    """The light in cells, as far as it is near, and the angles of their middles."""
    reach = int(np.ceil(far[1] / side_deg)) + 1
    # So many that they come in threes.
    reach += (1 - reach) % 3
    offset = np.arange(-reach, reach + 1) * side_deg
    deg = np.hypot(offset[:, None], offset)
    return part.cells(1 / side_deg, reach, wider) * (1 - smooth_step(deg, *far)), deg


def core_cells(part: Part, side_deg: float, far: tuple[float, float], wider: float) -> tuple[Reals, Reals]:
    """The same close to the axis."""
    reach = CORE_PER_PX * CORE_PX
    offset = np.arange(-reach, reach + 1) * side_deg
    deg = np.hypot(offset[:, None], offset)
    return part.cells(1 / side_deg, reach, wider) * (1 - smooth_step(deg, *far)), deg


def _threes(cells: Reals) -> Reals:
    o, i, k, _ = cells.shape
    return np.asarray(cells.reshape(o, i, k // 3, 3, k // 3, 3).sum(axis=(3, 5)))


def _far(part: Part, plane: Plane, wider: float) -> tuple[Array, Array]:
    """Transforms of A and B."""
    down, right = plane.distances()
    distance = np.hypot(down, right)
    least = plane.least_scale
    # Two directions at this distance have the largest g on either side of the axis.
    largest = np.maximum(1 / (1 + distance**2 / 16), least)
    of_cells = [_of_cells(part, plane, scale, wider) for scale in (1.0, least)]
    high, turning = parted(of_cells[0], of_cells[1] * least**FALLS, np.ones_like(distance), least)
    if part.veil is not None:
        ends = []
        for scale in (largest, least):
            deg = np.degrees(2 * np.arcsin(np.minimum(distance * scale / 2, 1)))
            ends.append(part.veil.density(np.maximum(deg, 1e-3), wider) * scale**FALLS)
        veil_high, veil_turning = parted(ends[0], ends[1], largest, least)
        alike = (np.eye(len(high)) if part.colour is None else part.colour[:, None])[:, :, None, None]
        high, turning = high + alike * veil_high, turning + alike * veil_turning
    return tuple(transform(each, plane, GAIN) for each in (high, turning))  # type: ignore[return-value]


def parted(at_largest: Reals, at_least: Reals, largest: Reals, least: float) -> tuple[Reals, Reals]:
    """A and B of what g^FALLS·K is at the largest and at the least g."""
    apart = largest**TURNS - least**TURNS
    turning = np.divide(at_largest - at_least, apart, out=np.zeros(at_largest.shape), where=apart > 0.02)
    return at_least - turning * least**TURNS, turning


def _of_cells(part: Part, plane: Plane, scale: float, wider: float) -> Reals:
    """Density of what is far and in a part's cells, (o, i, v, u), where angles are distances times `scale`."""
    side_deg = plane.step_deg * scale
    reach = min(whole.kernel_radius_px(1 / side_deg, wider), max(plane.height, plane.width) - 1)
    offset = np.arange(-reach, reach + 1) * side_deg
    deg = np.hypot(offset[:, None], offset)
    cells = part.cells(1 / side_deg, reach, wider) * smooth_step(deg, *far_deg(plane)) / (plane.step * scale) ** 2
    return _at_origin(cells, plane)


def _at_origin(cells: Reals, plane: Plane) -> Reals:
    """Cells around a point on the FFT's plane, as far as they reach from one end of the plane to the other."""
    reach = cells.shape[-1] // 2
    down, right = min(reach, plane.height - 1), min(reach, plane.width - 1)
    result = np.zeros((*cells.shape[:2], plane.fft_height, plane.fft_width))
    rows, columns = np.arange(-down, down + 1), np.arange(-right, right + 1)
    result[:, :, rows[:, None], columns] = cells[:, :, reach + rows[:, None], reach + columns]
    return result


def transform(density: Reals, plane: Plane, gain: float) -> Array:
    """Its FFT, with what B-splines and cells take from it raised again up to `gain` times."""
    v = np.fft.fftfreq(plane.fft_height)[:, None]
    u = np.fft.rfftfreq(plane.fft_width)[None, :]
    # Six powers of the two B-splines, two of the linear weights that pool pixels, one of the kernel's own cells.
    kept = np.abs(np.sinc(v) * np.sinc(u)) ** (9 if plane.pool > 1 else 7)
    return jax.device_put(np.complex64(scipy.fft.rfft2(density, workers=-1) / np.maximum(kept, 1 / gain)))


def profile_of(
    pixel_deg: float, core: Reals, core_deg: Reals, fine: Reals, fine_deg: Reals, reach_deg: float
) -> Callable[[Reals], Reals]:
    """Mean density of what is near, (o, …) at angles: each channel's of its own light."""
    angles, densities = [], []
    for cells, deg, side, low, high in (
        (core, core_deg, pixel_deg / CORE_PER_PX, 0.0, (CORE_PX - 0.5) * pixel_deg),
        (fine, fine_deg, pixel_deg / FINE_PER_PX, (CORE_PX - 0.5) * pixel_deg, reach_deg),
    ):
        ring = np.rint(deg / side).astype(int).ravel()
        count = np.maximum(np.bincount(ring), 1)
        at = np.bincount(ring, deg.ravel()) / count
        own = range(min(cells.shape[:2]))
        mean = np.stack([np.bincount(ring, cells[c, c].ravel()) / count for c in own])
        inside = (at >= low) & (at < high)
        angles.append(at[inside])
        densities.append(mean[:, inside] / np.radians(side) ** 2)
    at, mean = np.concatenate(angles), np.concatenate(densities, axis=1)
    return lambda deg: np.stack([np.interp(deg, at, of_channel, right=0.0) for of_channel in mean])


def taps_of(
    profile: Callable[[Reals], Reals], plane: Plane, level: int, stencil: Stencil, bounds: list[tuple[float, ...]]
) -> Reals:
    """(tap, power, o): what a pixel of a level scatters to one of each tap's, where pixels are that large."""
    side_deg = plane.step_deg / plane.pool * 2**level
    corner = np.hypot(plane.view.width_px, plane.view.height_px) / 2 / plane.view.focal_px
    sines = np.linspace(0, corner**2 / (1 + corner**2), ROWS)
    squares = 1 - sines
    degree = 0 if sines[-1] < 1e-3 else 1 if sines[-1] < 0.03 else DEGREE
    parts = (np.arange(8) + 0.5) / 8 - 0.5
    result = []
    for down, right in stencil:
        away = np.hypot((down + parts)[:, None], right + parts).ravel()
        # A pixel's sides differ off the axis: as if it were a square of the same area.
        deg = side_deg * squares[:, None] ** 0.75 * away
        density = profile(deg)
        if level + 1 < len(bounds) or plane.pool == 1:
            density = density * (1 - smooth_step(deg, *bounds[level]))
        if level:
            density = density * smooth_step(deg, *bounds[level - 1])
        light = density.mean(axis=2) * np.radians(side_deg) ** 2 * squares**1.5
        fitted = np.polynomial.polynomial.polyfit(sines, light.T, degree)
        result.append(np.concatenate([fitted, np.zeros((DEGREE - degree, fitted.shape[1]))]))
    return np.stack(result)


def amounts(mixture: Mixture) -> Mapping[Veil, float]:
    """The veils of a mixture and their weights."""
    result: dict[Veil, float] = {}
    for part, weight in mixture:
        if part.veil is not None:
            result[part.veil] = result.get(part.veil, 0.0) + weight
    return result
