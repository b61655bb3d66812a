"""A whole perceived frame, plainly: every effect, one after the other, none left out."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entoptic.pipeline.effects.tone.settings import Tone
from entoptic.pipeline.frame import Display, View
from entoptic.pipeline.oracles import acuity, adaptation, night_colour, operators, tone

Reals = NDArray[np.float64]


def perceived(
    rgb_cd_m2: ArrayLike, view: View, glare: Callable[[Reals], Reals], display: Display = Display()
) -> tuple[NDArray[np.uint8], dict[str, float]]:
    """An image (3, y, x) as code values (y, x, 3), seen straight ahead by an adapted eye; and each effect's ms.

    `glare` is sphere.glare with a function, or the identity.
    """
    milliseconds: dict[str, float] = {}

    def timed(part: str, run: Callable[[], Reals]) -> Reals:
        begun = time.perf_counter()
        result = run()
        milliseconds[part] = (time.perf_counter() - begun) * 1e3
        return result

    rgb = np.asarray(rgb_cd_m2, np.float64)
    adapted = float(timed("adaptation", lambda: np.asarray(adaptation.target_cd_m2(rgb, view))))
    image = timed("glare", lambda: glare(rgb))
    image = timed("acuity", lambda: acuity.fit(image))
    shown = timed("tone", lambda: operators.shown(image, adapted, Tone(), display))
    shown = timed("night_colour", lambda: night_colour.night_tint(shown, adapted))
    begun = time.perf_counter()
    codes = tone.encode(shown, display.black_cd_m2 / display.peak_cd_m2)
    milliseconds["encode"] = (time.perf_counter() - begun) * 1e3
    return codes, milliseconds
