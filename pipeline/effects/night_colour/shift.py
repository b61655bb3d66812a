"""Colour at night: each pixel a blend of what cones and what rods see.

Every method is displayed·(1 − s) + tint·(light that rods see)·s. They differ in the share s, the tint, and by which
weights rods see light (share.py, tints.py). KRI's blend of chromaticities is one of them too: x and y of a mixture lie
between those of its parts by their X + Y + Z, so with 1/y of the pixel and of the blue, KRI's σ becomes the share
s = σ·(1/y)/(4·(1 − σ) + σ·(1/y)) of a blue as luminous as the pixel, 4 being the blue's 1/y.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.display_gamut import within_peak
from entoptic.pipeline.effects.night_colour.settings import NightColour, NightMethod
from entoptic.pipeline.effects.night_colour.share import adapted_share, share
from entoptic.pipeline.effects.night_colour.tints import BLUE_XY, TINT, tint, weights
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, FrameError
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.primaries import SUM_WEIGHTS

LEAST_ABOVE_PEAK = 1e-3
"""What is above the peak by no more is left to be clipped: a quarter of a code value, and no pass more by day."""


def shift(
    displayed: Float[Array, "eye 3 y x"],
    adapted_cd_m2: Sequence[float] | NDArray[np.float64],
    settings: NightColour,
    scene: Float[Array, "eye 3 y x"] | None = None,
) -> Float[Array, "eye 3 y x"]:
    """A displayed frame (linear Rec.709, 0 or more, 1 = the display's peak) as eyes adapted to these luminances see it.

    `scene` is the same frame in cd/m², before tone mapping: settings.per_pixel needs it, nothing else does. A tint is
    brighter than white in blue: what it brings above 1 goes to white. Raises FrameError without a scene that is needed.
    """
    method = settings.method
    adapted = np.asarray(adapted_cd_m2, dtype=np.float64)
    tints = np.stack([tint(method, luminance_cd_m2) for luminance_cd_m2 in adapted]).astype(np.float32)
    seen_by = weights(method)
    if not settings.per_pixel:
        shares = adapted_share(adapted, settings).astype(np.float32)
        exceeds = may_exceed(method, float(shares.max()), float(tints.max()))
        return _blend(displayed, shares[:, None, None], tints, seen_by, method, exceeds)
    if scene is None:
        raise FrameError("night colour per pixel: pass the frame in cd/m² as well, or set per_pixel = false")
    return _blend_per_pixel(displayed, scene, tints, seen_by, method)


def may_exceed(method: NightMethod, largest_share: float, largest_tint: float) -> bool:
    """Whether a component may come out above the peak by more than LEAST_ABOVE_PEAK.

    As white does, whose components become 1 + s·(tint − 1). KRI's share of light is larger than its σ, and BAR's grey
    no brighter than what it is made of.
    """
    if method in (NightMethod.KRI_XY, NightMethod.BAR):
        return method is NightMethod.KRI_XY
    return largest_share * (largest_tint - 1) > LEAST_ABOVE_PEAK


def night_tint(displayed: Float[Array, "eye 3 y x"], rod_share: Float[Array, "eye"]) -> Float[Array, "eye 3 y x"]:
    """A displayed frame (linear, 1 = peak) blended towards LUI's tinted grey by the rods' share σ(L_i) in [0, 1]."""
    shares = jnp.asarray(rod_share, jnp.float32)[:, None, None]
    tints = jnp.broadcast_to(jnp.asarray(TINT, jnp.float32), (displayed.shape[0], 3))
    return _blend(displayed, shares, tints, LUMINANCE_WEIGHTS, NightMethod.LUI, True)


@functools.partial(jax.jit, static_argnames=("seen_by", "method", "exceeds"))
def _blend(
    displayed: Float[Array, "eye 3 y x"],
    shares: Float[Array, "eye #y #x"],
    tints: Float[Array, "eye 3"],
    seen_by: tuple[float, float, float],
    method: NightMethod,
    exceeds: bool,
) -> Float[Array, "eye 3 y x"]:
    if method is NightMethod.KRI_XY:
        shares = _of_blue(displayed, shares)
    seen = _weighted(displayed, seen_by)
    blended = displayed * (1 - shares[:, None]) + tints[:, :, None, None] * seen[:, None] * shares[:, None]
    return within_peak(blended) if exceeds else blended


@functools.partial(jax.jit, static_argnames=("seen_by", "method"))
def _blend_per_pixel(
    displayed: Float[Array, "eye 3 y x"],
    scene: Float[Array, "eye 3 y x"],
    tints: Float[Array, "eye 3"],
    seen_by: tuple[float, float, float],
    method: NightMethod,
) -> Float[Array, "eye 3 y x"]:
    shares = share(jnp.maximum(luminance(scene), 0), method)
    return _blend(displayed, shares, tints, seen_by, method, may_exceed(method, 1.0, np.inf))


def _of_blue(displayed: Float[Array, "eye 3 y x"], sigma: Float[Array, "eye #y #x"]) -> Float[Array, "eye y x"]:
    """KRI's σ as a share of light; 0 at black, where there is none."""
    blue = sigma * _weighted(displayed, SUM_WEIGHTS)
    all_light = (1 - sigma) * luminance(displayed) * np.float32(1 / BLUE_XY[1]) + blue
    return blue / jnp.maximum(all_light, np.float32(1e-30))


def _weighted(rgb: Float[Array, "eye 3 y x"], by: Sequence[float]) -> Float[Array, "eye y x"]:
    red, green, blue = (np.float32(weight) for weight in by)
    return red * rgb[:, 0] + green * rgb[:, 1] + blue * rgb[:, 2]
