"""A frame in cd/m² as the display shows it."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from entoptic.pipeline.display_light import seen_peak_cd_m2
from entoptic.pipeline.effects.adaptation import exposure
from entoptic.pipeline.effects.effect import Domain, Picture
from entoptic.pipeline.effects.pointwise import Planes, Pointwise, image_after, weighted
from entoptic.pipeline.effects.tone import durand, filmic, gamut, own_curve, reinhard, ward
from entoptic.pipeline.effects.tone.hue import divisor
from entoptic.pipeline.effects.tone.oklab import directions
from entoptic.pipeline.effects.tone.settings import Hue, Operator, Tone
from entoptic.pipeline.fast_math import clip, larger
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Display

_BRIGHTEST = 1e15
"""cd/m². A million suns: products of what is brighter would overflow."""


def show(
    rgb: Float[Array, "eye 3 y x"],
    adapted_cd_m2: Sequence[float],
    target_cd_m2: Sequence[float],
    settings: Tone,
    display: Display,
) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² as the display shows it, linear Rec.709 in [0, 1], 1 = the display's peak (display_light.py).

    `adapted_cd_m2` is what each eye is adapted to, `target_cd_m2` what it is on its way to. Components below 0 are
    those of spectral colours, as glare makes them. Raises FrameError where the file of a person's curve cannot be used.
    """
    return image_after(Picture(rgb, rgb), [of_pixels(adapted_cd_m2, target_cd_m2, settings, display)])


def of_pixels(
    adapted_cd_m2: Sequence[float],
    target_cd_m2: Sequence[float],
    settings: Tone,
    display: Display,
) -> Pointwise:
    """The same as a function of each pixel."""
    numbers = np.array(
        [
            coefficients(adapted, target, settings, display)
            for adapted, target in zip(adapted_cd_m2, target_cd_m2, strict=True)
        ],
        np.float32,
    )
    if settings.hue is not Hue.OKLAB:
        return Pointwise(_shown, Domain.DISPLAY, (numbers,), (), _curve(settings), (settings.operator, settings.hue))
    tables = (*_curve(settings), *_directions())
    return Pointwise(_clipped, Domain.DISPLAY, (numbers,), (), tables, (settings.operator,), exact=_to_white)


def coefficients(adapted_cd_m2: float, target_cd_m2: float, settings: Tone, display: Display) -> tuple[float, ...]:
    """The operator's numbers for an eye so adapted."""
    match settings.operator:
        case Operator.ACES:
            return (exposure(adapted_cd_m2) * filmic.display_scale_of(seen_peak_cd_m2(display)),)
        case Operator.REINHARD:
            return reinhard.coefficients(adapted_cd_m2, settings.white, display)
        case Operator.WARD:
            return ward.coefficients(adapted_cd_m2, target_cd_m2, display)
        case Operator.DURAND:
            return durand.coefficients(adapted_cd_m2, display)
        case Operator.CURVE:
            return (own_curve.unit_cd_m2(own_curve.read_curve(settings.curve), adapted_cd_m2),)


def full_cd_m2(adapted_cd_m2: float, target_cd_m2: float, settings: Tone, display: Display) -> float:
    """The scene's luminance, of white light, from which on the display shows its peak; infinite where it never does."""
    numbers = coefficients(adapted_cd_m2, target_cd_m2, settings, display)
    match settings.operator:
        case Operator.ACES:
            return filmic.FULL / numbers[0]
        case Operator.REINHARD:
            return reinhard.full_cd_m2(*numbers)
        case Operator.WARD:
            return ward.full_cd_m2(*numbers)
        case Operator.DURAND:
            return durand.full_cd_m2(*numbers)
        case Operator.CURVE:
            return own_curve.full_cd_m2(own_curve.read_curve(settings.curve), *numbers)


def _curve(settings: Tone) -> tuple[Array, ...]:
    return _curve_of(settings.curve) if settings.operator is Operator.CURVE else ()


@functools.cache
def _curve_of(path: str) -> tuple[Array, ...]:
    curve = own_curve.read_curve(path)
    first, step = (jnp.asarray(number, jnp.float32) for number in (curve.first_log10, curve.step_log10))
    return first, step, jnp.asarray(curve.shares)


@functools.cache
def _directions() -> tuple[Array, Array]:
    red, blue = directions()
    return jnp.asarray(red), jnp.asarray(blue)


def _shown(
    image: Planes,
    scene: Planes,
    numbers: tuple[Float[Array, "n number"]],
    planes: tuple[()],
    curve: tuple[Array, ...],
    operator: Operator,
    hue: Hue,
) -> Planes:
    if operator is Operator.ACES and hue is Hue.CLIP:
        return tuple(filmic.component(plane * numbers[0][:, 0, None, None]) for plane in image)
    lit = [clip(plane, 0, np.float32(_BRIGHTEST)) for plane in image]
    y = weighted(lit, LUMINANCE_WEIGHTS)
    gain, offset = _gain_and_offset(lit, y, numbers[0], curve, operator)
    divided_by = divisor(lit, y, gain, offset, hue)
    gain, offset = gain / divided_by, offset / divided_by
    return tuple(clip(larger(plane, 0) * gain + offset, 0, 1) for plane in image)


def _clipped(
    image: Planes,
    scene: Planes,
    numbers: tuple[Float[Array, "n number"]],
    planes: tuple[()],
    tables: tuple[Array, ...],
    operator: Operator,
) -> tuple[Planes, Bool[Array, "n y x"]]:
    mapped, beyond = _mapped(image, numbers[0], tables[:-2], operator)
    return tuple(clip(plane, 0, 1) for plane in mapped), beyond


def _to_white(
    image: Planes,
    scene: Planes,
    numbers: tuple[Float[Array, "n number"]],
    planes: tuple[()],
    tables: tuple[Array, ...],
    operator: Operator,
) -> Planes:
    mapped, beyond = _mapped(image, numbers[0], tables[:-2], operator)
    # Kept, or XLA works them out again for each of the steps that follow.
    *mapped, beyond = jax.lax.optimization_barrier((*mapped, beyond))
    white = gamut.to_white(mapped, *tables[-2:])
    return tuple(jnp.where(beyond, one, clip(plane, 0, 1)) for one, plane in zip(white, mapped, strict=True))


def _mapped(
    image: Planes, numbers: Float[Array, "n number"], curve: tuple[Array, ...], operator: Operator
) -> tuple[Planes, Bool[Array, "n y x"]]:
    """What the operator makes of it, of any size, and what of that lies beyond the display's colours."""
    y = weighted(image, LUMINANCE_WEIGHTS)
    gain, offset = _gain_and_offset(image, clip(y, 0, _BRIGHTEST), numbers, curve, operator)
    return tuple(plane * gain + offset for plane in image), gamut.is_beyond(image, y, gain, offset)


def _gain_and_offset(
    planes: Sequence[Float[Array, "eye y x"]],
    y: Float[Array, "eye y x"],
    numbers: Float[Array, "eye number"],
    curve: tuple[Array, ...],
    operator: Operator,
) -> tuple[Float[Array, "eye #y #x"], Float[Array, "eye 1 1"]]:
    """What colours of luminance y ≥ 0 in cd/m² are multiplied by, and what is added then."""
    first, last = numbers[:, 0, None, None], numbers[:, -1, None, None]
    none = jnp.zeros_like(first)
    match operator:
        case Operator.ACES:
            return filmic.gain(y, first), none
        case Operator.REINHARD:
            return reinhard.gain(y, first, last), none
        case Operator.WARD:
            return first, last
        case Operator.DURAND:
            return durand.gain(planes, y, first, last), none
        case Operator.CURVE:
            return own_curve.gain(y, first, *curve), none
