"""Noise near the absolute threshold: rods count photons, few of them, and now and then one fires by itself.

A patch of retina that acts as one (its grain) counts N events within the time that rods integrate: those of light and
those of heat. Counts scatter as Poisson's do, so what is seen scatters by 1/√N of itself: with a pupil of 7 mm by 14 %
at 0.001 cd/m², by 43 % at 1e-4 cd/m². The mean is the light that is there.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array, Float, UInt32
from numpy.typing import NDArray

from entoptic.described import described
from entoptic.pipeline.effects.effect import Cost, Domain, Effect, Picture, TileChanges, TileRanges
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, FrameError
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.mesopic import SCOTOPIC_WEIGHTS, WHITE_RATIO, scotopic_luminance
from entoptic.pipeline.ranges import Change, Range
from entoptic.pipeline.words import darkness

ISOMERISATIONS = 8.6
"""Photons that a rod catches, per scotopic troland second (Breton et al. 1994)."""
THERMAL_PER_S = 1 / 160
"""How often a rod fires in the dark (Baylor, Nunn & Schnapf 1984, macaque)."""
RODS_PER_DEG2 = 7000.0
"""92 million rods on 1094 mm² (Curcio et al. 1990), 0.29 mm to a degree."""
INTEGRATION_S = 0.1
"""How long rods sum light near the threshold (Bloch's law)."""
LARGEST = math.sqrt(6) * math.sqrt(2) ** 3
"""Beyond it the noise, whose standard deviation is 1, never goes: √6 for a node, √2 for each mean of two of them, in
time, along y and along x."""


class RodNoise(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Whether and how rods' noise is shown."""

    on: Annotated[
        bool, described("Off by default: the display and the eyes of the viewer have noise of their own.")
    ] = False
    seed: Annotated[
        int,
        described("Which of all noises; the same seed and time give the same noise.", ge=0, lt=2**32, slider=(0, 100)),
    ] = 0
    grain_deg: Annotated[
        float,
        described(
            "Side of the patch that counts as one. 0.3°: about the area over which rods sum light completely 5° off "
            "the fovea (Ricco's area).",
            ge=0.25,
            le=2.0,
        ),
    ] = 0.3
    below_cd_m2: Annotated[
        float,
        described(
            "Noise fades in below this luminance, as cones, which catch many more photons each, hand over to rods.",
            ge=1e-5,
            le=1.0,
        ),
    ] = 0.01
    own_light: Annotated[
        bool,
        described("Events of heat are seen as light too, a faint grey in full darkness; the mean then rises by it."),
    ] = False


def add_noise(
    rgb: Float[Array, "eye 3 y x"],
    elapsed_s: float,
    pupil_diameter_mm: Sequence[float],
    pixels_per_deg: float,
    settings: RodNoise,
) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² (linear Rec.709) as rods count it, `elapsed_s` ≥ 0 after the session's beginning.

    The noise depends on nothing but seed, time, eye and place, is smooth in time over INTEGRATION_S, and leaves a pixel
    of `below_cd_m2` or more as it is. Colours keep their chromaticity. Latency: none. Raises FrameError for a time that
    is no finite number.
    """
    if not math.isfinite(elapsed_s):
        raise FrameError(f"rod noise at {elapsed_s} s: give the seconds since the session began, a finite number")
    slots, fraction = divmod(max(elapsed_s, 0.0) / INTEGRATION_S, 1.0)
    counts = [_counts(pupil_diameter_mm, settings.grain_deg) for pupil_diameter_mm in pupil_diameter_mm]
    per_scotopic, thermal = (jnp.asarray(values, jnp.float32) for values in zip(*counts, strict=True))
    grain_px = max(1, round(settings.grain_deg * pixels_per_deg))
    eyes, _, height, width = rgb.shape
    grid = (eyes, -(-height // grain_px) + 1, -(-width // grain_px) + 1)
    # Each is compiled by itself: fused, XLA would work out every node again for each component of each pixel.
    nodes = _nodes(grid, np.uint32(int(slots) % 2**32), np.float32(fraction), np.uint32(settings.seed))
    factor, grey = _factor(
        rgb,
        _pixels(nodes, grain_px),
        per_scotopic[:, None, None],
        thermal[:, None, None],
        np.float32(settings.below_cd_m2),
        settings.own_light,
    )
    return _multiply(rgb, factor, grey)


def skip_bound(range_: Range, pupil_diameter_mm: float, settings: RodNoise) -> Change:
    """The most that leaving the noise out changes a pixel of one eye, cd/m²."""
    tiles = _Tiles(range_, np.zeros_like(range_.low), pupil_diameter_mm, settings)
    return np.asarray(tiles.fade * (tiles.high * tiles.noise + tiles.own * (1 + tiles.noise)))


def propagate(change: Change, range_: Range, pupil_diameter_mm: float, settings: RodNoise) -> Change:
    """What becomes of a change of the frame before the noise: the same noise falls on both."""
    tiles = _Tiles(range_.widened(change), change, pupil_diameter_mm, settings)
    loudest = 1 + tiles.fade * tiles.noise
    fades = np.minimum(change[3] / settings.below_cd_m2, tiles.fade)
    scotopic = _scotopic(change)
    # d/dN of ((z/2 + √(N − ¼))²/N − 1), z at its largest.
    n = tiles.fewest
    slope = LARGEST**2 / 4 / n**2 + LARGEST / n**1.5 + LARGEST / (2 * np.sqrt(n - 0.25) * n)
    louder = np.minimum(slope * tiles.per_scotopic * scotopic, 2 * tiles.noise)
    return np.asarray(
        loudest * change
        + (tiles.high + tiles.own) * (fades * tiles.noise + tiles.fade * louder)
        + tiles.own * fades * loudest
    )


class _Tiles:
    """What the bounds need to know of each tile; `range_` holds it before and after `change`."""

    def __init__(self, range_: Range, change: Change, pupil_diameter_mm: float, settings: RodNoise) -> None:
        self.per_scotopic, thermal = _counts(pupil_diameter_mm, settings.grain_deg)
        self.fewest = thermal + self.per_scotopic * _scotopic(range_.low)
        """Events at least."""
        # |(z/2 + √(N − ¼))²/N − 1|: k ≥ 0 keeps it above −1.
        self.noise = (LARGEST**2 / 4 - 0.25) / self.fewest + LARGEST / np.sqrt(self.fewest)
        """Largest change of a pixel relative to itself."""
        self.fade = np.maximum(1 - range_.low[3] / settings.below_cd_m2, 0)
        noisy = (settings.below_cd_m2 + change[3])[None] / np.array([*LUMINANCE_WEIGHTS, 1])[:, None, None]
        self.high = np.minimum(range_.high, noisy)
        """Of the pixels that noise reaches."""
        self.own = thermal / self.per_scotopic / WHITE_RATIO if settings.own_light else 0.0


def _scotopic(rgb: NDArray[np.float64]) -> NDArray[np.float64]:
    red, green, blue = SCOTOPIC_WEIGHTS
    return red * rgb[0] + green * rgb[1] + blue * rgb[2]


def _counts(pupil_diameter_mm: float, grain_deg: float) -> tuple[float, float]:
    """Events of a grain: per scotopic cd/m² of light, and of heat (0.25 or more for every grain allowed)."""
    rods = RODS_PER_DEG2 * grain_deg**2
    return (
        rods * INTEGRATION_S * ISOMERISATIONS * math.pi / 4 * pupil_diameter_mm**2,
        rods * INTEGRATION_S * THERMAL_PER_S,
    )


@functools.partial(jax.jit, static_argnames="grid")
def _nodes(
    grid: tuple[int, int, int], slot: UInt32[Array, ""], fraction: Float[Array, ""], seed: UInt32[Array, ""]
) -> Float[Array, "eye row column"]:
    """Independent values of mean 0 and variance 1: in time, the mean of two, weighed again to keep that variance."""
    early, late = (_triangular(grid, slot + np.uint32(k), seed) for k in (0, 1))
    return (early * (1 - fraction) + late * fraction) / jnp.sqrt((1 - fraction) ** 2 + fraction**2)


@functools.partial(jax.jit, static_argnames="grain_px")
def _pixels(nodes: Float[Array, "eye row column"], grain_px: int) -> Float[Array, "eye y x"]:
    return _between(_between(nodes, grain_px, 1), grain_px, 2)


@functools.partial(jax.jit, static_argnames="own_light")
def _factor(
    rgb: Float[Array, "eye 3 y x"],
    noise: Float[Array, "eye rows columns"],
    per_scotopic: Float[Array, "eye 1 1"],
    thermal: Float[Array, "eye 1 1"],
    below_cd_m2: Float[Array, ""],
    own_light: bool,
) -> tuple[Float[Array, "eye y x"], Float[Array, "eye y x"] | None]:
    """What each pixel is multiplied by, and the retina's own light, if it is seen, in cd/m² before that."""
    height, width = rgb.shape[2:]
    # With z of mean 0 and variance 1, (z/2 + √(N − ¼))² is never negative, has the mean N exactly, and a variance of
    # N − 1/8 or nearly: Poisson's is N (after Anscombe 1948).
    events = per_scotopic * jnp.maximum(scotopic_luminance(rgb), 0) + thermal
    counted = (noise[:, :height, :width] / 2 + jnp.sqrt(events - np.float32(0.25))) ** 2
    fade = jnp.clip(1 - luminance(rgb) / below_cd_m2, 0, 1)
    grey = fade * thermal / (per_scotopic * np.float32(WHITE_RATIO)) if own_light else None
    return 1 + fade * (counted / events - 1), grey


@jax.jit
def _multiply(
    rgb: Float[Array, "eye 3 y x"], factor: Float[Array, "eye y x"], grey: Float[Array, "eye y x"] | None
) -> Float[Array, "eye 3 y x"]:
    return (rgb if grey is None else rgb + grey[:, None]) * factor[:, None]


def _triangular(grid: tuple[int, int, int], slot: Array, seed: Array) -> Float[Array, "eye row column"]:
    """Independent values in ±√6 of mean 0 and variance 1: the sum of a hash's two halves."""
    index = jnp.arange(math.prod(grid), dtype=jnp.uint32).reshape(grid)
    bits = _mix(index ^ _mix(slot ^ _mix(seed)))
    total = (bits & np.uint32(0xFFFF)).astype(jnp.float32) + (bits >> np.uint32(16)).astype(jnp.float32)
    return (total - 65535) * np.float32(math.sqrt(6 / (65536**2 - 1)))


def _mix(bits: Array) -> Array:
    """A hash of 32 bits, each bit of which depends on all (Wellons 2018's constants, `lowbias32`)."""
    bits = (bits ^ (bits >> np.uint32(16))) * np.uint32(0x7FEB352D)
    bits = (bits ^ (bits >> np.uint32(15))) * np.uint32(0x846CA68B)
    return bits ^ (bits >> np.uint32(16))


def _between(nodes: Array, grain_px: int, axis: int) -> Array:
    """Values of pixels between nodes `grain_px` apart: means of the two, weighed to keep a standard deviation of 1."""
    along: NDArray[np.float64] = np.arange(grain_px) / grain_px
    shape = [1, 1, 1, 1]
    shape[axis + 1] = grain_px
    size = np.sqrt((1 - along) ** 2 + along**2)
    weights = [(part / size).astype(np.float32).reshape(shape) for part in (1 - along, along)]
    count = nodes.shape[axis]
    here = jnp.expand_dims(jax.lax.slice_in_dim(nodes, 0, count - 1, axis=axis), axis + 1)
    after = jnp.expand_dims(jax.lax.slice_in_dim(nodes, 1, count, axis=axis), axis + 1)
    fine = here * weights[0] + after * weights[1]
    merged = list(nodes.shape)
    merged[axis] = (count - 1) * grain_px
    return fine.reshape(merged)


if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext


class RodNoiseEffect(Effect[RodNoise, None]):
    """Noise near the absolute threshold."""

    name = "rod_noise"
    domain = Domain.SCENE
    Settings = RodNoise
    costs: Mapping[str, Cost] = {"on": Cost(0.5, 7.3)}

    def is_on(self, settings: RodNoise) -> bool:
        return settings.on

    def full_level(self, settings: RodNoise) -> str:
        return "on"

    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: RodNoise,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        pupil_diameters_mm = [eye.pupil_diameter_mm for eye in eyes]
        return add_noise(picture.image, eyes[0].time_s, pupil_diameters_mm, eyes[0].view.ppd_centre, settings)

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: RodNoise, level: str) -> Change:
        return skip_bound(ranges.image, eye.pupil_diameter_mm, settings)

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: RodNoise) -> Change:
        return propagate(changes.image, ranges.image, eye.pupil_diameter_mm, settings)

    def reason(self, eye: EyeContext, settings: RodNoise) -> str:
        return darkness(eye.measured, settings.below_cd_m2)

    def oracle(self, picture: Picture, eye: EyeContext, settings: RodNoise) -> NDArray[np.float64]:
        from entoptic.pipeline.oracles.rod_noise import noisy

        rgb = np.asarray(picture.image[0], np.float64)
        eyes = eye.frame.rgb_cd_m2.shape[0]
        return noisy(rgb, eye.time_s, eye.pupil_diameter_mm, eye.view.ppd_centre, settings, eye.image, eyes)

    def variants(self) -> Mapping[str, RodNoise]:
        return {"on": RodNoise(on=True)}


ROD_NOISE = RodNoiseEffect()
