import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline.scenes.discs import add_discs


def drawn(x_px: float, y_px: float, radius_px: float, half: int = 12) -> np.ndarray:
    place = (jnp.float32([value]) for value in (x_px, y_px, radius_px))
    return np.asarray(add_discs(jnp.zeros((3, 60, 70), jnp.float32), *place, jnp.float32([[1.0, 2.0, 3.0]]), half))


@pytest.mark.parametrize("radius_px", [0.01, 0.3, 1.0, 1.7, 2.2, 4.0, 8.0])
def test_flux_is_that_of_the_disc_wherever_in_a_pixel_it_lies(radius_px: float) -> None:
    random = np.random.default_rng(0)
    flux = [
        drawn(30 + x, 30 + y, radius_px).sum(axis=(1, 2), dtype=np.float64) for x, y in random.uniform(0, 1, (20, 2))
    ]
    expected = np.array([1.0, 2.0, 3.0]) * np.pi * radius_px**2
    np.testing.assert_allclose(flux, np.broadcast_to(expected, (20, 3)), rtol=0.01)


def test_disc_lies_where_it_is_asked_for() -> None:
    image = drawn(33.3, 21.8, 3.0)[0]
    y, x = np.mgrid[:60, :70] + 0.5
    assert ((image * x).sum() / image.sum(), (image * y).sum() / image.sum()) == pytest.approx((33.3, 21.8), abs=0.01)


def test_a_disc_across_a_border_loses_what_is_outside_and_nothing_comes_back_elsewhere() -> None:
    image = drawn(0.0, 30.0, 3.0)[0]
    assert image.sum() == pytest.approx(np.pi * 9 / 2, rel=0.02)
    assert image[:, 20:].max() == 0
    assert drawn(-40.0, -40.0, 3.0).max() == drawn(500.0, 20.0, 3.0).max() == 0
