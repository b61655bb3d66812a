"""Colour at night: each pixel a blend of what cones and what rods see.

Every method is displayed·(1 − s) + tint·(light that rods see)·s. They differ in the share s, the tint, and by which
weights rods see light (share.py, tints.py). KRI's blend of chromaticities is one of them too: x and y of a mixture lie
between those of its parts by their X + Y + Z, so with 1/y of the pixel and of the blue, KRI's σ becomes the share
s = σ·(1/y)/(4·(1 − σ) + σ·(1/y)) of a blue as luminous as the pixel, 4 being the blue's 1/y.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.display_gamut import within_peak
from entoptic.pipeline.effects.effect import Domain, Picture
from entoptic.pipeline.effects.night_colour.settings import NightColour, NightMethod
from entoptic.pipeline.effects.night_colour.share import adapted_share, share
from entoptic.pipeline.effects.night_colour.tints import BLUE_XY, TINT, tint, weights
from entoptic.pipeline.effects.pointwise import Planes, Pointwise, image_after, weighted
from entoptic.pipeline.fast_math import larger
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, FrameError
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
    if settings.per_pixel and scene is None:
        raise FrameError("night colour per pixel: pass the frame in cd/m² as well, or set per_pixel = false")
    picture = Picture(displayed, displayed if scene is None else scene)
    return image_after(picture, [of_pixels(adapted_cd_m2, settings)])


def of_pixels(adapted_cd_m2: Sequence[float] | NDArray[np.float64], settings: NightColour) -> Pointwise:
    """The same as a function of each pixel."""
    method = settings.method
    adapted = np.asarray(adapted_cd_m2, dtype=np.float64)
    tints = np.stack([tint(method, luminance_cd_m2) for luminance_cd_m2 in adapted]).astype(np.float32)
    if settings.per_pixel:
        exceeds = may_exceed(method, 1.0, np.inf)
        return Pointwise(_blended_by_its_own, Domain.DISPLAY, (tints,), static=(method, exceeds))
    shares = adapted_share(adapted, settings).astype(np.float32)
    exceeds = may_exceed(method, float(shares.max()), float(tints.max()))
    return Pointwise(_blended, Domain.DISPLAY, (tints, shares), static=(method, exceeds))


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
    tints = jnp.broadcast_to(jnp.asarray(TINT, jnp.float32), (displayed.shape[0], 3))
    numbers = tints, jnp.asarray(rod_share, jnp.float32)
    blend = Pointwise(_blended, Domain.DISPLAY, numbers, static=(NightMethod.LUI, True))
    return image_after(Picture(displayed, displayed), [blend])


def _blended(
    image: Planes,
    scene: Planes,
    numbers: tuple[Float[Array, "n 3"], Float[Array, "n"]],
    planes: tuple[()],
    tables: tuple[()],
    method: NightMethod,
    exceeds: bool,
) -> Planes:
    tints, shares = numbers
    return _blend(image, shares[:, None, None], tints, method, exceeds)


def _blended_by_its_own(
    image: Planes,
    scene: Planes,
    numbers: tuple[Float[Array, "n 3"]],
    planes: tuple[()],
    tables: tuple[()],
    method: NightMethod,
    exceeds: bool,
) -> Planes:
    shares = share(larger(weighted(scene, LUMINANCE_WEIGHTS), 0), method)
    return _blend(image, shares, numbers[0], method, exceeds)


def _blend(
    image: Planes, shares: Float[Array, "n #y #x"], tints: Float[Array, "n 3"], method: NightMethod, exceeds: bool
) -> Planes:
    if method is NightMethod.KRI_XY:
        shares = _of_blue(image, shares)
    by_rods = weighted(image, weights(method)) * shares
    blended = [plane * (1 - shares) + tints[:, k, None, None] * by_rods for k, plane in enumerate(image)]
    return within_peak(blended) if exceeds else tuple(blended)


def _of_blue(image: Planes, sigma: Float[Array, "n #y #x"]) -> Float[Array, "n y x"]:
    """KRI's σ as a share of light; 0 at black, where there is none."""
    blue = sigma * weighted(image, SUM_WEIGHTS)
    all_light = (1 - sigma) * weighted(image, LUMINANCE_WEIGHTS) * np.float32(1 / BLUE_XY[1]) + blue
    return blue / larger(all_light, np.float32(1e-30))
