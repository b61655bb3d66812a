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
from entoptic.pipeline.effects.tone import durand, filmic, gamut, own_curve, reinhard, ward
from entoptic.pipeline.effects.tone.hue import divisor, weighted
from entoptic.pipeline.effects.tone.settings import Hue, Operator, Tone
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
    if settings.operator is Operator.ACES and settings.hue is Hue.CLIP:
        return filmic.aces(rgb, np.array([exposure(cd_m2) for cd_m2 in adapted_cd_m2]), seen_peak_cd_m2(display))
    eyes = [
        coefficients(adapted, target, settings, display)
        for adapted, target in zip(adapted_cd_m2, target_cd_m2, strict=True)
    ]
    numbers, table = np.array(eyes, np.float32), _table(settings)
    if settings.hue is not Hue.OKLAB:
        return _show(rgb, numbers, *table, settings.operator, settings.hue)
    clipped, gain, offset, blocks = _show_and_mark(rgb, numbers, *table, settings.operator)
    return gamut.map_blocks(clipped, rgb, gain, offset, np.asarray(blocks))


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


def _table(settings: Tone) -> tuple[np.float32, np.float32, np.ndarray]:
    if settings.operator is not Operator.CURVE:
        return np.float32(0), np.float32(1), np.zeros(2, np.float32)
    curve = own_curve.read_curve(settings.curve)
    return np.float32(curve.first_log10), np.float32(curve.step_log10), curve.shares


@functools.partial(jax.jit, static_argnames=("operator", "hue"))
def _show(
    rgb: Float[Array, "eye 3 y x"],
    numbers: Float[Array, "eye number"],
    first_log10: Float[Array, ""],
    step_log10: Float[Array, ""],
    shares: Float[Array, "sample"],
    operator: Operator,
    hue: Hue,
) -> Float[Array, "eye 3 y x"]:
    # Plane by plane, and the result clipped instead of `rgb`: a clipped copy of it all costs four times as much.
    planes = [jnp.clip(rgb[:, k], 0, np.float32(_BRIGHTEST)) for k in range(3)]
    y = weighted(planes, LUMINANCE_WEIGHTS)
    gain, offset = _gain_and_offset(planes, y, numbers, first_log10, step_log10, shares, operator)
    divided_by = divisor(planes, y, gain, offset, hue)
    # Without the barrier XLA works the gain out for each component again.
    mapped = jnp.maximum(rgb, 0) * jax.lax.optimization_barrier(gain / divided_by)[:, None]
    if operator is Operator.WARD:
        mapped = mapped + (offset / divided_by)[:, None]
    return jnp.clip(mapped, 0, 1)


@functools.partial(jax.jit, static_argnames="operator")
def _show_and_mark(
    rgb: Float[Array, "eye 3 y x"],
    numbers: Float[Array, "eye number"],
    first_log10: Float[Array, ""],
    step_log10: Float[Array, ""],
    shares: Float[Array, "sample"],
    operator: Operator,
) -> tuple[Float[Array, "eye 3 y x"], Float[Array, "eye y x"], Float[Array, "eye 1 1"], Bool[Array, "eye row column"]]:
    """The frame clipped; gains, negative where a colour is beyond the display; what is added; blocks that hold one."""
    planes = [jnp.clip(rgb[:, k], -np.float32(_BRIGHTEST), np.float32(_BRIGHTEST)) for k in range(3)]
    y = weighted(planes, LUMINANCE_WEIGHTS)
    gain, offset = _gain_and_offset(planes, jnp.maximum(y, 0), numbers, first_log10, step_log10, shares, operator)
    gain = jax.lax.optimization_barrier(gamut.marked_gain(planes, y, gain, offset))
    clipped = rgb * jnp.abs(gain)[:, None]
    if operator is Operator.WARD:
        clipped = clipped + offset[:, None]
    return jnp.clip(clipped, 0, 1), gain, offset, gamut.marked_blocks(gain)


def _gain_and_offset(
    planes: Sequence[Float[Array, "eye y x"]],
    y: Float[Array, "eye y x"],
    numbers: Float[Array, "eye number"],
    first_log10: Float[Array, ""],
    step_log10: Float[Array, ""],
    shares: Float[Array, "sample"],
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
            return own_curve.gain(y, first, first_log10, step_log10, shares), none
