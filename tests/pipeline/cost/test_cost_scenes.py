"""The frames that all effects are compared on: their light is what it is said to be."""

from __future__ import annotations

import numpy as np
import pytest

from entoptic.pipeline.cost import landscape, rooms, scenes
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View

SMALL = View(72, 80)


def luminance(name: str, view: View = SMALL) -> np.ndarray:
    rgb = np.asarray(scenes.SCENES[name](view).rgb_cd_m2[0], np.float64)
    return np.asarray(np.einsum("c,cyx->yx", np.array(LUMINANCE_WEIGHTS), rgb))


@pytest.mark.parametrize("name", scenes.SCENES)
def test_every_scene_is_a_clean_frame_at_any_size(name: str) -> None:
    rgb = np.asarray(scenes.scene(name, 31, 17).frame.rgb_cd_m2)
    assert rgb.shape == (1, 3, 17, 31)
    assert rgb.dtype == np.float32
    assert np.isfinite(rgb).all()
    assert rgb.min() >= 0


def test_they_go_from_scotopic_to_photopic_and_to_the_sun() -> None:
    medians = {name: float(np.median(luminance(name))) for name in scenes.SCENES}
    ascending = ["starlight", "moonlight", "dusk", "bright room", "sunny landscape"]
    assert [medians[name] for name in ascending] == sorted(medians[name] for name in ascending)
    assert medians["starlight"] < 1e-3 < medians["moonlight"] < 0.03
    assert 0.03 < medians["dusk"] < 3 < 100 < medians["bright room"] < 200
    assert medians["sunny landscape"] > 3000
    assert luminance("moonlight").max() < 0.05  # no lamps


def test_the_same_place_at_twice_the_size() -> None:
    small, large = luminance("dusk"), luminance("dusk", View(144, 160))
    blocks = large.reshape(80, 2, 72, 2).mean(axis=(1, 3))
    assert np.median(np.abs(blocks / small - 1)) < 0.1


def test_the_suns_flux_is_its_own() -> None:
    view = View(240, 200)
    added = luminance("sun disc", view) - luminance("sunny landscape", view)
    disc_px = np.pi * (landscape.SUN_RADIUS_DEG * view.ppd_centre) ** 2
    assert added.sum() == pytest.approx(landscape.SUN_CD_M2 * disc_px, rel=0.03)


class TestBrightRoom:
    def test_it_lies_between_100_and_200_and_no_edge_exceeds_a_fifth(self) -> None:
        image = luminance("bright room", View(144, 160))
        assert 100 <= image.min() <= image.max() <= 200
        for axis in (0, 1):
            step = np.abs(np.diff(np.log(image), axis=axis))
            assert step.max() < np.log(1.2)

    def test_what_a_wall_sees_of_the_ceiling_is_the_sum_over_its_parts(self) -> None:
        """View factors against their integral: ∫ cos·cos/(π r²) dA."""
        below, reach, away = 1.3, 2.1, 3.4
        n = 800
        along = (np.arange(n) + 0.5) / n * reach
        out = (np.arange(n) + 0.5) / n * away
        a, o = np.meshgrid(along, out, indexing="ij")
        squared = a * a + o * o + below * below
        cell = reach * away / n**2
        upright = (o * below / (np.pi * squared**2)).sum() * cell
        level = (below * below / (np.pi * squared**2)).sum() * cell
        depth = np.array(below)
        assert float(rooms._perpendicular(np.array(reach), away, depth)) == pytest.approx(upright, rel=1e-4)
        assert float(rooms._parallel(np.array(reach), np.array(away), depth)) == pytest.approx(level, rel=1e-4)

    def test_under_an_endless_ceiling_a_wall_sees_half_and_the_floor_all(self) -> None:
        wide = np.array(1e9)
        assert 2 * float(rooms._perpendicular(wide, 1e9, np.array(1.0))) == pytest.approx(0.5, rel=1e-6)
        assert 4 * float(rooms._parallel(wide, wide, np.array(1.0))) == pytest.approx(1.0, rel=1e-6)


def test_the_candles_wall_is_lit_by_the_inverse_square() -> None:
    """Of the end wall, the point straight behind the flame: I/d² · albedo/π, and what the walls send back."""
    view = View(400, 400)
    rgb = np.asarray(rooms.candle_room(view).rgb_cd_m2[0], np.float64)
    image = np.einsum("c,cyx->yx", np.array(LUMINANCE_WEIGHTS), rgb)
    x, y = rooms.CANDLE_M[:2] / rooms.HIGH_M[2] * view.focal_px
    distance = rooms.HIGH_M[2] - rooms.CANDLE_M[2]
    lux = rooms.CANDLE_CD / distance**2 + rooms.REFLECTED_LX
    found = image[int(200 - y), int(200 + x)]
    assert found == pytest.approx(lux * rooms.WALL / np.pi, rel=0.01)
