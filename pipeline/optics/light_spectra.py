"""What each wavelength contributes to the colours of a display and of a light.

Everything is summed over equal bands of wavelengths from tables at every nanometre, so a few bands carry all the light
of a narrow line. A band stands for its middle.

colour-science is imported where it is used: it takes two seconds, which who only asks for help need not wait.
"""

from __future__ import annotations

import csv
import functools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.optics import OpticsError

RANGE_NM = (380.0, 770.0)
"""KRI 4.3, RIT 4."""
WAVELENGTHS = 32
"""As many as RIT 4 sums."""
WAVELENGTHS_RANGE = (4, 128)
"""Engineering choice: under four bands a halo has fewer colours than the display, over 128 nothing changes any more."""
PER_PIXEL_PER_DEG, FEWEST = 2.6, 24
"""How many wavelengths a kernel needs for each pixel per degree. Neighbouring copies of what lies at an angle θ are
θ·Δλ/λ apart, at the halo's 3.1° that is 2.1° over their number, and should be closer than a pixel. Engineering choice:
the halo's pixels are then within 1 % (root mean square) of what 128 wavelengths make, from 5 to 60 pixels per degree;
the halo itself needs 24."""

Wavelengths = NDArray[np.float64]


def _gaussian(nm: Wavelengths, peak_nm: float, sigma_nm: float) -> Wavelengths:
    return np.asarray(np.exp(-((nm - peak_nm) ** 2) / (2 * sigma_nm**2)))


def _white_led(nm: Wavelengths) -> Wavelengths:
    """A blue peak and phosphor (KRI 6.1)."""
    return 0.5 * _gaussian(nm, 560, 60) + 0.9 * _gaussian(nm, 450, 10)


def _three_peak_led(nm: Wavelengths) -> Wavelengths:
    """Narrow lobes where the eye is most sensitive (KRI 6.1, fig. 6.5, which gives no numbers).

    Engineering choice: the peaks of z̄, ȳ and x̄ at KRI's narrow width, as high as each other.
    """
    return _gaussian(nm, 446, 10) + _gaussian(nm, 555, 10) + _gaussian(nm, 599, 10)


FORMULAS: dict[str, Callable[[Wavelengths], Wavelengths]] = {
    "LED-KRI": _white_led,
    "LED-KRI-3": _three_peak_led,
}
"""Lights that colour-science does not have."""
ALIASES = {"tungsten": "A", "incandescent": "A", "daylight": "D65"}


def names() -> list[str]:
    """Of all lights that `light_weights` knows."""
    import colour

    return [*FORMULAS, *ALIASES, *colour.SDS_ILLUMINANTS]


@functools.cache
def _observer() -> tuple[Wavelengths, Float[np.ndarray, "nm 3"]]:
    """Every nanometre of the range, and the linear Rec.709 RGB of a watt there, negative where out of gamut."""
    import colour

    nm = np.arange(RANGE_NM[0], RANGE_NM[1] + 1)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    to_rgb = np.asarray(colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_XYZ_to_RGB)
    return nm, np.asarray(cmfs[nm]) @ to_rgb.T


@functools.cache
def primaries() -> tuple[Wavelengths, Float[np.ndarray, "nm 3"]]:
    """Every nanometre of the range, and the spectra of the linear Rec.709 primaries there; read-only.

    Mallett and Yuksel's (2019) reflectances that make up sRGB, lit by D65: nowhere negative, and together D65. Mixed so
    that each spectrum's colour is its primary's exactly: by 0.1 % at most, what Mallett's
    five nanometres and other ends of the range leave.
    """
    from colour.recovery import MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019

    nm, rgb_of_watt = _observer()
    table = MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    reflectances = np.stack([np.interp(nm, table.wavelengths, table.values[:, c]) for c in range(3)], axis=1)
    spectra = reflectances * _tabulated("D65", nm)[:, None]
    spectra = spectra @ np.linalg.inv(rgb_of_watt.T @ spectra)
    spectra.flags.writeable = False
    return nm, spectra


def wavelengths_for(pixels_per_deg: float) -> int:
    """How many wavelengths a kernel of so many pixels per degree needs."""
    return min(max(math.ceil(PER_PIXEL_PER_DEG * pixels_per_deg), FEWEST), WAVELENGTHS_RANGE[1])


def primary_weights(
    count: int = WAVELENGTHS,
) -> tuple[Float[np.ndarray, "wavelength"], Float[np.ndarray, "wavelength 3 3"]]:
    """Wavelengths in nm, and the linear RGB that each contributes to the colour of each primary: [wavelength, out, in].

    Over all wavelengths they add up to the identity. A wavelength's luminance is never negative, but its channels are,
    where it lies outside Rec.709. Raises OpticsError for a count outside `WAVELENGTHS_RANGE`.
    """
    spectra = primaries()[1]
    return _in_bands(spectra[:, None, :] * _observer()[1][:, :, None], _checked(count))


def light_weights(
    name_or_path: str | Path, count: int = WAVELENGTHS
) -> tuple[Float[np.ndarray, "wavelength"], Float[np.ndarray, "wavelength 3"]]:
    """Wavelengths in nm, and the linear RGB that each contributes to a light of luminance 1.

    The light is one of `names()` or a CSV file with the columns nm and relative power. Raises OpticsError for unknown
    names, files that are no such table, and a count outside `WAVELENGTHS_RANGE`.
    """
    nm, rgb_of_watt = _observer()
    _checked(count)
    watts = _power(name_or_path, nm)
    middles, sums = _in_bands(watts[:, None] * rgb_of_watt, count)
    luminance = float(sums.sum(axis=0) @ _luminance_of_rgb())
    if luminance <= 0:
        raise OpticsError(
            f"{name_or_path} has no light that is seen: give power between {RANGE_NM[0]:.0f} and {RANGE_NM[1]:.0f} nm"
        )
    return middles, sums / luminance


def _luminance_of_rgb() -> Float[np.ndarray, "3"]:
    import colour

    return np.asarray(colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_RGB_to_XYZ)[1]


def _checked(count: int) -> int:
    low, high = WAVELENGTHS_RANGE
    if not low <= count <= high:
        raise OpticsError(f"{count} wavelengths: use {low} to {high}")
    return count


def _in_bands(values: Float[np.ndarray, "nm *c"], count: int) -> tuple[Wavelengths, Float[np.ndarray, "band *c"]]:
    """The middles of equal bands over the range, and the sums of each; a nanometre between two bands is shared."""
    low, high = RANGE_NM
    edges = np.linspace(low - 0.5, high + 0.5, count + 1)
    nm = np.arange(low, high + 1)
    upper, lower = np.minimum(edges[1:, None], nm + 0.5), np.maximum(edges[:-1, None], nm - 0.5)
    return (edges[1:] + edges[:-1]) / 2, np.tensordot(np.clip(upper - lower, 0, None), values, axes=1)


def _tabulated(name: str, nm: Wavelengths) -> Wavelengths:
    import colour

    table = colour.SDS_ILLUMINANTS[name]
    return np.interp(nm, table.wavelengths, table.values, left=0, right=0)


def _power(name_or_path: str | Path, nm: Wavelengths) -> Wavelengths:
    import colour

    name = str(name_or_path)
    name = ALIASES.get(name, name)
    if name in FORMULAS:
        return FORMULAS[name](nm)
    if name in colour.SDS_ILLUMINANTS:
        return _tabulated(name, nm)
    path = Path(name_or_path)
    if path.suffix.lower() == ".csv" or path.is_file():
        return _from_file(path, nm)
    raise OpticsError(f"no light is called {name!r}: use a CSV file of nm and power, or one of {', '.join(names())}")


def _from_file(path: Path, nm: Wavelengths) -> Wavelengths:
    """A table of two columns, nm and relative power, linear in between and nothing beyond; a heading is allowed."""

    def wrong(what: str) -> OpticsError:
        return OpticsError(f"{path}: {what}; a light's file has two columns, nm rising and power not below 0")

    try:
        with path.open(newline="", encoding="utf-8-sig") as lines:
            rows = [row for row in csv.reader(lines) if row and not row[0].lstrip().startswith("#")]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise wrong(f"cannot be read ({error})") from error
    points: list[tuple[float, float]] = []
    for number, row in enumerate(rows, 1):
        try:
            at_nm, power = (float(cell) for cell in row)
        except ValueError:
            if number == 1:
                continue
            raise wrong(f"row {number} is {','.join(row)!r}") from None
        if not (math.isfinite(at_nm) and math.isfinite(power) and power >= 0):
            raise wrong(f"row {number} is {','.join(row)!r}")
        if points and at_nm <= points[-1][0]:
            raise wrong(f"{at_nm:g} nm comes after {points[-1][0]:g} nm")
        points.append((at_nm, power))
    if len(points) < 2:
        raise wrong(f"has {len(points)} rows of numbers")
    at, power_at = np.array(points).T
    return np.interp(nm, at, power_at, left=0, right=0)
