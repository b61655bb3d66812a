"""How accommodation wavers while an eye looks at one thing (RIT 3.3): a sum of tones in two bands of frequency.

Theory of operation: RIT makes the low band of value noise. Sums of sinusoids of random frequencies and phases do the
same, have exactly the wanted spectrum and are the same function of time for one observer whatever the frame rate; and
what they drive (lens_springs.py) has a closed form. Both eyes accommodate together and so share them.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
from jaxtyping import Complex, Float

LOW_HZ = (0.02, 0.6)
"""The low band ends at 0.6 Hz (RIT 3.3). Its lower end, and that its power falls as 1/f, are engineering choices: what
takes longer than 50 s is no fluctuation any more, and the slow drifts are the large ones (Campbell, Robson & Westheimer
1959, J. Physiol. 145, 579)."""
HIGH_HZ = (1.3, 2.1)
"""The high band (RIT 3.3): narrow, so its power falls off from its middle to nothing at both ends."""
TONES = 12
"""In each band. Engineering choice: they come together again only after minutes, and Gaussian enough."""
LOW_RMS_D_PER_MM = 0.033
"""Standard deviation of the low band for each mm of pupil, so that its power grows with the pupil's area (RIT 3.3).
That holds for pupils which the light makes wide, as it is dim light that makes the low band strong; behind artificial
pupils of one light it is the smallest that do (Gray, Winn & Gilmartin 1993, Vision Res. 33, 2083 and 2091).
Engineering choice: 0.07 D at 2 mm, 0.26 D at 8 mm, with the high band 0.10–0.28 D in all; measured are 0.1–0.5 D
(Charman & Heron 1988, Ophthalmic Physiol. Opt. 8, 153)."""
HIGH_RMS_D = 0.08
"""Standard deviation of the high band, whatever the pupil. Engineering choice, as above."""
_STREAM = 0x6D66
"""This part's own random numbers."""


@dataclasses.dataclass(frozen=True, eq=False)
class Tones:
    """A signal Re Σ a·exp(iωt)."""

    omega_rad_s: Float[np.ndarray, "tone"]
    amplitude: Complex[np.ndarray, "tone"]

    def at(self, t_s: float) -> Complex[np.ndarray, "tone"]:
        """The tones at a time, of which the signal is the sum's real part."""
        return self.amplitude * np.exp(1j * self.omega_rad_s * t_s)


@functools.lru_cache(maxsize=8)
def _unit_tones(seed: int) -> tuple[Tones, Tones]:
    """The low and the high band of this eye, each of standard deviation 1."""
    random = np.random.default_rng([seed, _STREAM])
    return _band(LOW_HZ, random, falls=True), _band(HIGH_HZ, random, falls=False)


def _band(range_hz: tuple[float, float], random: np.random.Generator, *, falls: bool) -> Tones:
    low, high = range_hz
    # One tone in each equal part of the band (of its logarithm where power goes as 1/f): none has two or is empty.
    share = (np.arange(TONES) + random.random(TONES)) / TONES
    if falls:
        hz = low * (high / low) ** share
        amplitude = np.ones(TONES)
    else:
        hz = low + (high - low) * share
        amplitude = np.sin(math.pi * share)
    amplitude = amplitude * math.sqrt(2.0 / float(np.sum(amplitude**2)))
    return Tones(2 * math.pi * hz, amplitude * np.exp(2j * math.pi * random.random(TONES)))


def tones_d(seed: int, pupil_diameter_mm: float) -> Tones:
    """What accommodation does too much, in dioptres, of the eye of this seed with this pupil."""
    low, high = _unit_tones(seed)
    return Tones(
        np.concatenate([low.omega_rad_s, high.omega_rad_s]),
        np.concatenate([LOW_RMS_D_PER_MM * pupil_diameter_mm * low.amplitude, HIGH_RMS_D * high.amplitude]),
    )


def fluctuation_d(seed: int, t_s: float, pupil_diameter_mm: float) -> float:
    """The same at one time. Standard deviation over time: (0.033·pupil_diameter_mm, 0.08) D of the two bands."""
    return float(tones_d(seed, pupil_diameter_mm).at(t_s).real.sum())
