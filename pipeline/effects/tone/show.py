"""A frame in cd/m² as the display shows it."""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.display_light import seen_peak_cd_m2
from entoptic.pipeline.effects.adaptation import exposure
from entoptic.pipeline.effects.tone import durand, filmic, own_curve, reinhard, ward
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

    `adapted_cd_m2` is what each eye is adapted to, `target_cd_m2` what it is on its way to. Components below 0, colours
    of glare that no display has, are shown as 0. Raises FrameError where the file of a person's curve cannot be used.
    """
    if settings.operator is Operator.ACES and settings.hue is Hue.CLIP:
        return filmic.aces(rgb, np.array([exposure(cd_m2) for cd_m2 in adapted_cd_m2]), seen_peak_cd_m2(display))
    eyes = [
        coefficients(adapted, target, settings, display)
        for adapted, target in zip(adapted_cd_m2, target_cd_m2, strict=True)
    ]
    table = _table(settings)
    return _show(rgb, np.array(eyes, np.float32), *table, settings.operator, settings.hue)


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
    first, last = numbers[:, 0, None, None], numbers[:, -1, None, None]
    # Plane by plane, and the result clipped instead of `rgb`: a clipped copy of it all costs four times as much.
    planes = [jnp.clip(rgb[:, k], 0, np.float32(_BRIGHTEST)) for k in range(3)]
    y = weighted(planes, LUMINANCE_WEIGHTS)
    offset = jnp.zeros_like(first)
    match operator:
        case Operator.ACES:
            gain = filmic.gain(y, first)
        case Operator.REINHARD:
            gain = reinhard.gain(y, first, last)
        case Operator.WARD:
            gain, offset = first, last
        case Operator.DURAND:
            gain = durand.gain(planes, y, first, last)
        case Operator.CURVE:
            gain = own_curve.gain(y, first, first_log10, step_log10, shares)
    divided_by = divisor(planes, y, gain, offset, hue)
    # Without the barrier XLA works the gain out for each component again.
    mapped = jnp.maximum(rgb, 0) * jax.lax.optimization_barrier(gain / divided_by)[:, None]
    if operator is Operator.WARD:
        mapped = mapped + (offset / divided_by)[:, None]
    return jnp.clip(mapped, 0, 1)
