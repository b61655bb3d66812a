import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, FrameError, View
from entoptic.pipeline.scenes import open_scene
from entoptic.pipeline.scenes.image_file import band_solid_angles
from entoptic.pipeline.scenes.images import Pictures
from entoptic.pipeline.scenes.night_street import NightStreet
from entoptic.pipeline.scenes.panorama import Panorama

Write = Callable[..., Path]


def test_what_a_spec_opens(write_hdr: Write) -> None:
    assert isinstance(open_scene("night-street", mean_luminance_cd_m2=None), NightStreet)
    wide = open_scene(str(write_hdr("wide.hdr", np.ones((16, 32, 3)))), mean_luminance_cd_m2=None)
    assert isinstance(wide, Panorama)
    assert wide.view_for(None, None, 104.0) == View(720, 800, 104.0)
    assert any("panorama" in note for note in wide.notes)
    assert any("default" in note for note in wide.notes)
    assert isinstance(open_scene(str(write_hdr("a.hdr", np.ones((16, 31, 3)))), mean_luminance_cd_m2=None), Pictures)


def test_panorama_is_scaled_to_its_mean(write_hdr: Write) -> None:
    scene = open_scene(str(write_hdr("wide.exr", np.full((16, 32, 3), 0.25))), mean_luminance_cd_m2=3.0)
    assert isinstance(scene, Panorama)
    np.testing.assert_allclose(scene.rgb_cd_m2, 3.0, rtol=1e-5)


@pytest.mark.parametrize("mean", [0.0, -1.0, math.nan, math.inf])
def test_mean_luminance_must_be_a_positive_number(mean: float) -> None:
    with pytest.raises(FrameError, match="positive number"):
        open_scene("night-street", mean_luminance_cd_m2=mean)


def test_the_street_has_luminances_of_its_own() -> None:
    with pytest.raises(FrameError, match="leave the mean luminance out"):
        open_scene("night-street", mean_luminance_cd_m2=1.0)


def test_what_is_not_there_or_no_scene_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FrameError, match=r'"nowhere".*no such file or folder.*night-street'):
        open_scene("nowhere", mean_luminance_cd_m2=None)
    (tmp_path / "photo.jpg").write_bytes(b"\xff\xd8")
    with pytest.raises(FrameError, match=r"photo\.jpg: not a format"):
        open_scene(str(tmp_path / "photo.jpg"), mean_luminance_cd_m2=None)


@pytest.mark.shared_data
def test_a_real_photo_says_what_was_repaired(shared: Callable[[str], Path]) -> None:
    scene = open_scene(str(shared("hdr/openexr_CandleGlass.exr")), mean_luminance_cd_m2=None)
    assert "openexr_CandleGlass.exr: 1107 negative, 0 NaN, 0 infinite components set to usable values." in scene.notes
    assert any("default" in note for note in scene.notes)


@pytest.mark.shared_data
def test_a_real_photo_keeps_its_own_scale(shared: Callable[[str], Path]) -> None:
    scene = open_scene(str(shared("hdr/openexr_Tree.exr")), mean_luminance_cd_m2=None)
    assert any("621 cd/m², its own whiteLuminance" in note for note in scene.notes)
    assert any("own chromaticities to Rec.709" in note for note in scene.notes)


@pytest.mark.shared_data
@pytest.mark.parametrize(("asked", "expected"), [(None, 100.0), (0.5, 0.5)])
def test_a_real_panorama_has_the_mean_that_was_asked_for(
    shared: Callable[[str], Path], asked: float | None, expected: float
) -> None:
    scene = open_scene(str(shared("hdr/pmndrs_night.hdr")), mean_luminance_cd_m2=asked)
    assert isinstance(scene, Panorama)
    luminance = np.tensordot(LUMINANCE_WEIGHTS, scene.rgb_cd_m2.astype(np.float64), 1)
    assert luminance.mean(axis=1) @ band_solid_angles(512) == pytest.approx(expected, rel=1e-4)
