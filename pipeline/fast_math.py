"""Minimum, maximum, cube root, exponential and arc tangent of float32, at a fraction of what XLA's take.

XLA's minimum hands on what is no number, and tells 0 from −0: five instructions where a processor has one.

The first two start from the bits of a float, exponent above mantissa, which are nearly its logarithm to base 2, and
have only multiplications besides. XLA also rewrites products of its own exponentials as exponentials of sums, which
would make three of each one that the blur needs.
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

Values = Any
"""An array of float32 or a constant."""
MANTISSA_BITS = 23
INVERSE_ROOT_BITS = 1419920000.0
"""4/3 of the bits of 1, less what makes the first guess of an inverse cube root err as far up as down: 3.5 %."""
EXP2_COEFFICIENTS = (0.0018850784, 0.0089696461, 0.055845409, 0.24014547, 0.69315438, 0.99999989)
"""2^x on 0…1, highest power first: the polynomial of fifth degree of least relative error, 6e-8 before rounding, found
as a linear programme over 4001 points."""

ARCTAN_COEFFICIENTS = (0.0068118585, -0.033604452, 0.079623996, -0.13233365, 0.19807824, -0.33317369, 0.99999611)
"""arctan(x)/x on 0…1 in powers of x², highest first: the least error of x times it, 3e-7, found likewise."""


def smaller(x: Values, other: Values) -> Values:
    """The smaller of two; the second where one is no number."""
    return jnp.where(x < other, x, other)


def larger(x: Values, other: Values) -> Values:
    """The larger of two; the second where one is no number."""
    return jnp.where(x > other, x, other)


def clip(x: Float[Array, "..."], low: float | np.float32, high: float | np.float32) -> Float[Array, "..."]:
    """x between two constants; the lower one where it is no number."""
    return smaller(larger(x, np.float32(low)), np.float32(high))


def cube_root(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """x^(1/3) of positive normal float32, within 2e-7 of it. Of others a number without meaning; nothing is raised."""
    third = np.float32(1 / 3)
    root = _float((np.float32(INVERSE_ROOT_BITS) - _bits(x).astype(jnp.float32) * third).astype(jnp.int32))
    # x^(-1/3) = root·(1 − error)^(-1/3), by its series: the error goes from 0.1 to 1e-5, and from there to nothing.
    error = 1 - x * root * root * root
    root = root * (1 + error * (third + error * (np.float32(2 / 9) + error * np.float32(14 / 81))))
    error = 1 - x * root * root * root
    root = root + root * error * (third + error * np.float32(2 / 9))
    return x * root * root


def exp2(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """2^x of float32 from −126 to 127, within 3e-7 of it."""
    whole = jnp.floor(x)
    rest = x - whole
    power = jnp.full_like(x, EXP2_COEFFICIENTS[0])
    for coefficient in EXP2_COEFFICIENTS[1:]:
        power = power * rest + np.float32(coefficient)
    return _float(_bits(power) + (whole.astype(jnp.int32) << MANTISSA_BITS))


def arctan(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """Arc tangent of float32, within 5e-7 of it: XLA's own takes sixty times as long."""
    size = jnp.abs(x)
    steep = size > 1
    slope = jnp.where(steep, 1 / jnp.maximum(size, 1), size)
    square = slope * slope
    ratio = jnp.full_like(x, ARCTAN_COEFFICIENTS[0])
    for coefficient in ARCTAN_COEFFICIENTS[1:]:
        ratio = ratio * square + np.float32(coefficient)
    angle = slope * ratio
    return jnp.sign(x) * jnp.where(steep, np.float32(math.pi / 2) - angle, angle)


def _bits(x: Float[Array, "..."]) -> Int[Array, "..."]:
    return jax.lax.bitcast_convert_type(x, jnp.int32)


def _float(bits: Int[Array, "..."]) -> Float[Array, "..."]:
    return jax.lax.bitcast_convert_type(bits, jnp.float32)
