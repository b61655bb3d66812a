"""What crosses from the device to the host while a frame is rendered: tiles' statistics, and what the display gets."""

import contextlib
import functools
from collections.abc import Callable, Iterator

import jax
import numpy as np
import pytest
from jax._src.array import ArrayImpl

from entoptic.pipeline import EFFECTS, Effects, EyePose, Frame, Observer, Planning, perceive
from entoptic.pipeline.measure import TILES

APART = {"glare"}
"""Effects that are held against this elsewhere, or not yet."""
SIDE_PX = 768
STATISTICS_BYTES = 3 * 4 * TILES**2
"""Red, green and blue of each tile, float32."""


@contextlib.contextmanager
def crossing() -> Iterator[list[jax.Array]]:
    """Each array that the host fetches. On a graphics card JAX itself also refuses what is not asked for."""
    noted: list[jax.Array] = []
    inside: list[bool] = []

    def within(array: jax.Array, fetch: Callable[[], np.ndarray]) -> np.ndarray:
        # One way of fetching goes by way of others.
        if not inside:
            noted.append(array)
        inside.append(True)
        try:
            return fetch()
        finally:
            inside.pop()

    def value(self: ArrayImpl, plain: property = ArrayImpl._value) -> np.ndarray:
        return within(self, lambda: plain.fget(self))  # type: ignore[misc]

    def through(plain: Callable[..., np.ndarray], of: object, *more: object, **named: object) -> np.ndarray:
        fetch = functools.partial(plain, of, *more, **named)
        return within(of, fetch) if isinstance(of, ArrayImpl) else fetch()

    with pytest.MonkeyPatch.context() as patch, jax.transfer_guard_device_to_host("disallow"):
        patch.setattr(ArrayImpl, "_value", property(value))
        # On a processor NumPy reads an array of JAX's where it lies.
        for name in ("asarray", "array"):
            patch.setattr(np, name, functools.partial(through, getattr(np, name)))
        yield noted


def street(luminance_cd_m2: float) -> Frame:
    """A dark frame with a lamp that no display shows."""
    random = np.random.default_rng(3)
    rgb = luminance_cd_m2 * random.uniform(0.5, 1.5, (SIDE_PX, SIDE_PX, 1)) * np.ones(3)
    rgb[300:310, 400:410] = (2e4, 1e2, 1e2)
    return Frame.from_rgb(rgb, 90.0)


@pytest.mark.parametrize("planning", [Planning(), Planning(everything=True), Planning(budget_ms=30.0)])
@pytest.mark.parametrize("luminance_cd_m2", [0.01, 30.0])
def test_no_array_larger_than_the_tiles_statistics_crosses_to_the_host(
    luminance_cd_m2: float, planning: Planning
) -> None:
    frame = street(luminance_cd_m2)
    effects = Effects(
        **{
            effect.name: next(iter(effect.variants().values()))
            for effect in EFFECTS
            if effect.optional and effect.name not in APART
        }
    )
    asked = Planning(planning.everything, planning.leave_out | APART, budget_ms=planning.budget_ms)
    eye, observer = EyePose(pupil_diameter_mm=5.0), Observer(particles=100)
    # The first frame makes tables that all others use.
    state = perceive(frame, eye, observer=observer, effects=effects, planning=asked).state
    for _ in range(2):
        with crossing() as fetched:
            seen = perceive(frame, eye, observer=observer, effects=effects, planning=asked, state=state, dt_s=0.02)
        state = seen.state
        *others, largest = sorted(array.nbytes for array in fetched)
        assert largest == seen.image.nbytes
        assert others
        assert others[-1] <= STATISTICS_BYTES


@pytest.mark.parametrize("fetch", [jax.device_get, lambda array: np.asarray(array)])
def test_a_fetched_frame_is_noted(fetch: Callable[[jax.Array], np.ndarray]) -> None:
    frame = street(1.0)
    with crossing() as fetched, jax.transfer_guard_device_to_host("allow"):
        fetch(frame.rgb_cd_m2 + 1)
    assert [array.nbytes for array in fetched] == [frame.rgb_cd_m2.nbytes]
