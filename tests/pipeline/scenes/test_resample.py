import numpy as np
import pytest

from entoptic.pipeline.scenes.resample import area_mean, resize


@pytest.mark.parametrize("count", [1, 3, 7, 20, 21, 64])
def test_mean_stays(count: int) -> None:
    values = np.random.default_rng(0).uniform(0, 5, (3, 20)).astype(np.float32)
    np.testing.assert_allclose(area_mean(values, count).mean(axis=1), values.mean(axis=1), rtol=1e-6)


def test_whole_ratios_are_block_means_and_copies() -> None:
    values = np.arange(6, dtype=np.float32)
    np.testing.assert_array_equal(area_mean(values, 3), [0.5, 2.5, 4.5])
    np.testing.assert_array_equal(area_mean(values, 12), np.repeat(values, 2))


def test_a_part_of_a_pixel_counts_for_its_part() -> None:
    np.testing.assert_allclose(area_mean(np.array([1.0, 0.0, 4.0], np.float32), 2), [2 / 3, 8 / 3], rtol=1e-6)


def test_starlight_beside_the_sun_keeps_its_digits() -> None:
    values = np.full(1000, 1e-6, np.float32)
    values[500] = 1.6e9
    smaller = area_mean(values, 300)
    np.testing.assert_allclose(np.delete(smaller, np.flatnonzero(smaller > 1)), 1e-6, rtol=1e-6)


def test_resize_is_area_exact_in_both_directions() -> None:
    image = np.random.default_rng(1).uniform(0, 1, (3, 9, 10)).astype(np.float32)
    smaller = resize(image, 4, 5)
    assert smaller.shape == (3, 4, 5)
    assert smaller.dtype == np.float32
    np.testing.assert_allclose(smaller.mean(axis=(1, 2)), image.mean(axis=(1, 2)), rtol=1e-6)
