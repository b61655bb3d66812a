"""A frame in cd/m² as the display shows it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Array, Float

from pipeline.effects.adaptation import exposure
from pipeline.effects.tone import filmic
from pipeline.effects.tone.seen import seen_peak_cd_m2
from pipeline.effects.tone.settings import Tone
from pipeline.frame import Display


def show(
    rgb: Float[Array, "eye 3 y x"],
    adapted_cd_m2: Sequence[float],
    target_cd_m2: Sequence[float],
    settings: Tone,
    display: Display,
) -> Float[Array, "eye 3 y x"]:
    """A frame in cd/m² as the display shows it, linear Rec.709 in [0, 1], 1 = the display's peak (seen.py).

    `adapted_cd_m2` is what each eye is adapted to, `target_cd_m2` what it is on its way to.
    """
    exposures = np.array([exposure(luminance_cd_m2) for luminance_cd_m2 in adapted_cd_m2])
    return filmic.aces(rgb, exposures, seen_peak_cd_m2(display))
