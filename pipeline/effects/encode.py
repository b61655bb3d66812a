"""From the display's linear light to the code values that make it show it, one function for each Encoding.

A code is looked up, not computed: an encoding is a staircase, and a float32's upper 16 bits name a cell in which it has
at most one step. So a table with an entry a cell says the code at the cell's start and where in it the next one begins,
for any transfer function at the price of one look-up: less than half of what a logarithm and an exponential cost.

**sRGB, Display P3** hold shares of the display's range, black and reflected light removed: code 0 is the display's
black. **HDR10** holds the absolute cd/m² that the display is to send out, without what it reflects: what lies below its
black it cannot show, but the code says what is meant. **Linear** is the
light itself as a share of the peak, for whoever encodes it later. Colours are clipped in the encoding's own primaries:
what lies outside Rec.709 and inside the display's gamut is kept.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt8, UInt16, UInt32
from numpy.typing import NDArray

from entoptic.pipeline.display_light import black_share, reflected_cd_m2, seen_peak_cd_m2
from entoptic.pipeline.fast_math import larger, smaller
from entoptic.pipeline.frame import Display, Encoding

Primaries = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
"""xy of red, green and blue."""
REC709: Primaries = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))
"""ITU-R BT.709."""
P3: Primaries = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060))
"""SMPTE EG 432-1."""
REC2020: Primaries = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046))
"""ITU-R BT.2020."""
WHITE = (0.3127, 0.3290)
"""D65 as all three standards round it."""

PQ_PEAK_CD_M2 = 10000.0
"""What the last PQ code stands for (SMPTE ST 2084)."""
PQ_CODES = 1023
"""HDR10 has 10 bits. All codes are used: full range, as stills have them."""
_M1, _M2 = 2610 / 16384, 2523 / 4096 * 128
_C1, _C2, _C3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
"""Exponents and coefficients of ST 2084."""
_SLOPE, _JOINT, _SCALE, _OFFSET, _GAMMA = 12.92, 0.0031308, 1.055, 0.055, 2.4
"""sRGB's line, where it ends, and the power's scale, offset and root (IEC 61966-2-1)."""


@dataclasses.dataclass(frozen=True, eq=False)
class Codes:
    """A transfer function as a staircase over [0, 1]."""

    entries: NDArray[np.int32]
    """(cell): the code at the cell's start × 2¹⁶, and 2¹⁶ minus the offset at which the next one begins, 0 for none.

    Added to a float's lower 16 bits, the sum's upper bits are the code.
    """
    first: int
    """Upper 16 bits of the first cell's start; what lies below it has the code 0."""


@dataclasses.dataclass(frozen=True)
class Coding:
    """What XLA compiles an encoding for."""

    first: int
    """See Codes."""
    bits: int
    """Of a component's code."""
    primaries: tuple[tuple[float, ...], ...] | None
    """From Rec.709 to the encoding's; None: they are the same."""


@dataclasses.dataclass(frozen=True, eq=False)
class Encoder:
    """A display's encoding with codes."""

    coding: Coding
    numbers: tuple[np.float32, np.float32]
    """Its black as a share of the peak, and what shares above it are multiplied by."""
    entries: Int[Array, "cell"]
    """See Codes."""


def encode(
    linear: Float[Array, "eye 3 y x"], display: Display
) -> UInt8[np.ndarray, "eye y x 3"] | Float[np.ndarray, "eye y x 3"] | UInt16[np.ndarray, "eye y x 3"]:
    """What a display is sent to show `linear`: Rec.709, 1 = the display's peak and the light it reflects.

    What is below 0 or NaN shows black.

    uint8 for sRGB and Display P3; uint16 of 0 to 1023 for HDR10; float32 of 0 to 1 for linear.
    """
    encoder = encoder_of(display)
    return jax.device_get(_shares(linear)) if encoder is None else _encoded(linear, encoder)


def encoder_of(display: Display) -> Encoder | None:
    """A display's encoding; None for linear light, which has no codes."""
    match display.encoding:
        case Encoding.LINEAR:
            return None
        case Encoding.HDR10:
            reflected = reflected_cd_m2(display) / seen_peak_cd_m2(display)
            return _encoder(reflected, display.peak_cd_m2 / PQ_PEAK_CD_M2, Encoding.HDR10, _between(REC2020))
        case Encoding.DISPLAY_P3:
            return _encoder(black_share(display), 1.0, Encoding.DISPLAY_P3, _between(P3))
        case Encoding.SRGB:
            return _encoder(black_share(display), 1.0, Encoding.SRGB, None)


def srgb_codes(linear: Float[Array, "eye 3 y x"], black_share: float) -> UInt8[np.ndarray, "eye y x 3"]:
    """Code values for a display with the sRGB transfer function whose black is `black_share` of its peak."""
    return _encoded(linear, _encoder(black_share, 1.0, Encoding.SRGB, None))


def packed(
    planes: Sequence[Float[Array, "n y x"]],
    numbers: tuple[Float[Array, ""], Float[Array, ""]],
    entries: Int[Array, "cell"],
    coding: Coding,
) -> UInt32[Array, "n y x"]:
    """Each pixel's three codes in one number, red's bits lowest: it is worked out once and written at once."""
    black, scale = numbers
    lowest = np.int32(coding.first << 16).view(np.float32)
    if coding.primaries is not None:
        planes = [
            row[0] * planes[0] + row[1] * planes[1] + row[2] * planes[2]
            for row in np.asarray(coding.primaries, np.float32)
        ]
    pixel = jnp.zeros_like(planes[0], jnp.uint32)
    for k, light in enumerate(planes):
        shown = (light - black) / (1 - black) * scale
        shown = smaller(larger(shown, lowest), np.float32(1))
        bits = jax.lax.bitcast_convert_type(shown, jnp.uint32)
        # Without a sign, or each place is looked at for whether it counts from the end.
        entry = entries.at[(bits >> 16) - np.uint32(coding.first)].get(mode="promise_in_bounds").astype(jnp.uint32)
        pixel = pixel | ((entry + (bits & 0xFFFF)) >> 16) << (coding.bits * k)
    return pixel


def unpacked(
    pixels: UInt32[Array, "eye y x"], coding: Coding
) -> UInt8[np.ndarray, "eye y x 3"] | UInt16[np.ndarray, "eye y x 3"]:
    """The codes of packed pixels, component by component."""
    if coding.bits == 8 and pixels.size % 4 == 0:
        return jax.device_get(_words(pixels)).view(np.uint8).reshape(*pixels.shape, 3)
    return jax.device_get(_components(pixels, coding.bits))


def matrix(source: Primaries, target: Primaries) -> NDArray[np.float64]:
    """What takes linear RGB of one set of primaries to another, both with D65 white: (target, source)."""
    return np.asarray(np.linalg.solve(to_xyz(target), to_xyz(source)))


def to_xyz(primaries: Primaries) -> NDArray[np.float64]:
    """What takes linear RGB to XYZ, white at Y = 1 (SMPTE RP 177): (XYZ, RGB)."""
    columns = np.array([[x / y, 1, (1 - x - y) / y] for x, y in primaries]).T
    white = np.array([WHITE[0] / WHITE[1], 1, (1 - sum(WHITE)) / WHITE[1]])
    return np.asarray(columns * np.linalg.solve(columns, white))


def srgb_signal(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB's signal of light in [0, 1] (IEC 61966-2-1)."""
    # In place: new arrays of a frame's tiles cost more than what is computed in them.
    power = np.log(np.maximum(share, 1e-30))
    power /= _GAMMA
    np.exp(power, out=power)
    power *= _SCALE
    power -= _OFFSET
    return np.where(share <= _JOINT, _SLOPE * share, power)


def pq_signal(share: NDArray[np.float64]) -> NDArray[np.float64]:
    """PQ's signal of light in [0, 1], 1 being PQ_PEAK_CD_M2 (ST 2084, the inverse EOTF)."""
    power = share**_M1
    return np.asarray(((_C1 + _C2 * power) / (1 + _C3 * power)) ** _M2)


def pq_cd_m2(signal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Luminance of a PQ signal in [0, 1] (ST 2084, the EOTF)."""
    power = signal ** (1 / _M2)
    return np.asarray(PQ_PEAK_CD_M2 * (np.maximum(power - _C1, 0) / (_C2 - _C3 * power)) ** (1 / _M1))


def staircase(steps: NDArray[np.float32]) -> Codes:
    """A table from the least float32 of each code from 1 on, ascending, within (0, 1].

    Raises ValueError where two lie in one cell.
    """
    bits = steps.view(np.uint32)
    # A whole power of two below the first step.
    first = int(bits[0] >> 23) << 7
    starts = np.arange(first, (int(np.float32(1).view(np.uint32)) >> 16) + 1, dtype=np.uint32) << np.uint32(16)
    code = np.searchsorted(bits, starts, side="right")
    after = np.searchsorted(bits, starts + np.uint32(0xFFFF), side="right")
    if (after - code).max() > 1:
        raise ValueError("two code values within 2⁻⁷ of an octave: the table's cells are too wide")
    step = np.where(after > code, bits[np.minimum(code, len(bits) - 1)] & np.uint32(0xFFFF), 0x10000)
    return Codes(((code << 16) + 0x10000 - step).astype(np.int32), first)


def _encoded(linear: Float[Array, "eye 3 y x"], encoder: Encoder) -> NDArray[np.uint8] | NDArray[np.uint16]:
    return unpacked(_packed_image(linear, encoder.numbers, encoder.entries, encoder.coding), encoder.coding)


def _encoder(
    black_share: float, scale: float, encoding: Encoding, primaries: tuple[tuple[float, ...], ...] | None
) -> Encoder:
    entries, first = _table(encoding)
    coding = Coding(first, 10 if encoding is Encoding.HDR10 else 8, primaries)
    # Narrowed here: a float64 would be narrowed again for each pixel.
    return Encoder(coding, (np.float32(black_share), np.float32(scale)), entries)


@functools.partial(jax.jit, static_argnames="coding")
def _packed_image(
    linear: Float[Array, "eye 3 y x"],
    numbers: tuple[Float[Array, ""], Float[Array, ""]],
    entries: Int[Array, "cell"],
    coding: Coding,
) -> UInt32[Array, "eye y x"]:
    return packed([linear[:, k] for k in range(3)], numbers, entries, coding)


@jax.jit
def _words(pixels: UInt32[Array, "eye y x"]) -> UInt32[Array, "word"]:
    """The bytes of four pixels in three words, by which they are moved four times as fast as one by one."""
    one, two, three, four = (pixels.reshape(-1, 4) & 0xFFFFFF).T
    return jnp.stack([one | two << 24, two >> 8 | three << 16, three >> 16 | four << 8], 1)


@functools.partial(jax.jit, static_argnames="bits")
def _components(pixels: UInt32[Array, "eye y x"], bits: int) -> Array:
    parts = [pixels >> (bits * k) & (2**bits - 1) for k in range(3)]
    return jnp.stack(parts, -1).astype(jnp.uint8 if bits == 8 else jnp.uint16)


@jax.jit
def _shares(linear: Float[Array, "eye 3 y x"]) -> Float[Array, "eye y x 3"]:
    return jnp.minimum(jnp.where(linear > 0, linear, 0), 1).transpose(0, 2, 3, 1)


@functools.cache
def _table(encoding: Encoding) -> tuple[Array, int]:
    if encoding == Encoding.HDR10:
        steps = pq_cd_m2((np.arange(1, PQ_CODES + 1) - 0.5) / PQ_CODES) / PQ_PEAK_CD_M2
        least = steps.astype(np.float32)
        codes = staircase(np.where(least < steps, np.nextafter(least, np.float32(1)), least).astype(np.float32))
    else:
        codes = staircase(_srgb_steps())
    return jnp.asarray(codes.entries), codes.first


@functools.cache
def _between(target: Primaries) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix(REC709, target).tolist())


def _srgb_steps() -> NDArray[np.float32]:
    """The least float32 of each code by the formula below: by halving intervals of bit patterns."""
    code = np.arange(1, 256)
    low, high = np.zeros(255, np.int32), np.full(255, np.float32(1).view(np.int32))
    while (high - low).max() > 1:
        middle = (low + (high - low) // 2).astype(np.int32)
        reached = np.asarray(_srgb_formula(jnp.asarray(middle.view(np.float32)))) >= code
        low, high = np.where(reached, low, middle), np.where(reached, middle, high)
    return high.astype(np.int32).view(np.float32)


@jax.jit
def _srgb_formula(shown: Float[Array, "..."]) -> UInt8[Array, "..."]:
    """Codes of values in [0, 1] (IEC 61966-2-1), power by exp and log in float32.

    The table is made of it, not of the formula in float64: which light gets which code is thus what a renderer in
    float32 gives that works the formula out. The other would differ in one code value of 100,000, by one.
    """
    root = jnp.exp(jnp.log(jnp.maximum(shown, np.float32(1e-8))) * np.float32(1 / _GAMMA))
    power = np.float32(_SCALE) * root - np.float32(_OFFSET)
    encoded = jnp.where(shown <= np.float32(_JOINT), np.float32(_SLOPE) * shown, power)
    return jnp.round(encoded * 255).astype(jnp.uint8)
