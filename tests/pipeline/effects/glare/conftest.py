import functools
from collections.abc import Callable

import numpy as np
import pytest

from entoptic.pipeline import Frame, View
from entoptic.pipeline.effects.glare.kernel import Component, component
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.measure import Measurement, measure

MakeComponent = Callable[..., Component]


@functools.cache
def _component(seed: int, radius: int, *, channels: int = 3, veil_share: float = 0.05) -> Component:
    """A ragged kernel falling with the square of the distance; its colours leave Rec.709, its luminance is positive."""
    random = np.random.default_rng(seed)
    offset = np.arange(-radius, radius + 1)
    away = np.hypot(offset[:, None], offset)
    grey = (1 - away / away.max()) * random.random(away.shape) / (away + 0.3) ** 2
    grey *= (1 - veil_share) / grey.sum()
    if channels == 1:
        return component(grey, None, veil_share)
    # From each primary, light that turns from its own colour to its neighbours' and back: its sum is the primary.
    turn = random.random((3, *away.shape)) - 0.5
    kernel = np.zeros((3, 3, *away.shape))
    red, green, blue = LUMINANCE_WEIGHTS
    for i in range(3):
        swing = grey * turn[i] * min(LUMINANCE_WEIGHTS[i], 0.5)
        swing[radius, radius] -= swing.sum()
        kernel[i, i] = grey
        # Towards a colour without luminance: red + and green −, or green + and blue −.
        kernel[0, i] += swing / red
        kernel[1 if i < 2 else 2, i] -= swing / (green if i < 2 else blue)
    return component(kernel, None, veil_share)


@pytest.fixture
def make_component() -> MakeComponent:
    return _component


@pytest.fixture
def measured() -> Callable[[np.ndarray, View], Measurement]:
    def of(rgb: np.ndarray, view: View) -> Measurement:
        return measure(Frame(np.asarray(rgb, np.float32)[None], view))[0]

    return of
