"""The rods' share of vision, 0 to 1: it falls as luminance in cd/m² rises.

Each function works on floats and NumPy arrays in float64 and on JAX arrays in float32.
"""

from __future__ import annotations

from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline import mesopic
from entoptic.pipeline.effects.night_colour.settings import NightColour, NightMethod
from entoptic.pipeline.mesopic import HALF_CD_M2

Values = TypeVar("Values", NDArray[np.float64], jax.Array)

HUNT = (0.069, 1.409, 4.267)
"""BAR 11, a fit to Hunt 2004."""
PHOTOPIC_CD_M2 = 3.0
"""From here on colours are full (BAR 11)."""


def share(luminance_cd_m2: Values, method: NightMethod) -> Values:
    """The method's own function of luminance ≥ 0."""
    if method is NightMethod.BAR:
        return _hunt(luminance_cd_m2)
    half = np.float32(HALF_CD_M2) if isinstance(luminance_cd_m2, jax.Array) else HALF_CD_M2
    return half / (half + luminance_cd_m2)


def adapted_share(adapted_cd_m2: NDArray[np.float64], settings: NightColour) -> NDArray[np.float64]:
    """The share in an eye adapted to each of these luminances."""
    adapted = np.asarray(adapted_cd_m2, dtype=np.float64)
    if settings.mesopic:
        return np.vectorize(mesopic.rod_share, otypes=[np.float64])(adapted)
    return share(adapted, settings.method)


def largest_step(low_cd_m2: NDArray[np.float64], step: NDArray[np.float64], method: NightMethod) -> NDArray[np.float64]:
    """At most how much the share changes where luminance, `low_cd_m2` or more, changes by up to `step`."""
    if method is NightMethod.BAR:
        # A logistic function is steepest in its middle.
        steepest = HUNT[2] / 4 / _colour(PHOTOPIC_CD_M2)
        return np.minimum(steepest * step, share(low_cd_m2, method))
    # Convex: steepest at its darkest.
    return share(low_cd_m2, method) - share(low_cd_m2 + step, method)


def _hunt(luminance_cd_m2: Values) -> Values:
    """1 − σ of BAR 11, whose step of 5.6·10⁻⁵ at 3 cd/m² is spread over the whole curve: there it is 0."""
    xp = jnp if isinstance(luminance_cd_m2, jax.Array) else np
    a, b, c = (np.float32(value) if xp is jnp else value for value in HUNT)
    below = xp.minimum(luminance_cd_m2, np.float32(PHOTOPIC_CD_M2) if xp is jnp else PHOTOPIC_CD_M2)
    colour = a / (a + b * xp.exp(-c * below))
    full = _colour(PHOTOPIC_CD_M2)
    return 1 - xp.minimum(colour / (np.float32(full) if xp is jnp else full), 1)


def _colour(luminance_cd_m2: float) -> float:
    a, b, c = HUNT
    return float(a / (a + b * np.exp(-c * luminance_cd_m2)))
