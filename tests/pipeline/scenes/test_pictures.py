from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from entoptic.pipeline.frame import Cleaned, FrameError, View
from entoptic.pipeline.scenes import open_scene
from entoptic.pipeline.scenes.images import FPS
from entoptic.pipeline.scenes.scene import Head
from entoptic.tracker_bridge.wire import Eye

Write = Callable[..., Path]


def grey(value: float, height: int = 6, width: int = 9) -> np.ndarray:
    return np.full((height, width, 3), value, np.float32)


def test_a_picture_has_its_own_size_and_does_not_follow_the_head(write_hdr: Write) -> None:
    pixels = np.random.default_rng(0).uniform(0.1, 2, (6, 9, 3)).astype(np.float32)
    scene = open_scene(str(write_hdr("a.exr", pixels, whiteLuminance=10.0)), mean_luminance_cd_m2=None)
    view = scene.view_for(None, None, 40.0)
    assert view == View(9, 6, 40.0)
    frame = scene.frame(3.0, view, Head(50, 10, 5), (Eye.RIGHT, Eye.LEFT))
    assert frame.rgb_cd_m2.shape == (2, 3, 6, 9)
    np.testing.assert_array_equal(frame.rgb_cd_m2[0], frame.rgb_cd_m2[1])
    np.testing.assert_allclose(frame.rgb_cd_m2[0], pixels.transpose(2, 0, 1) * 10, rtol=1e-6)
    assert any("fixed before the eyes" in note for note in scene.notes)


def test_another_size_keeps_the_mean(write_hdr: Write) -> None:
    pixels = np.random.default_rng(0).uniform(0.1, 2, (60, 90, 3)).astype(np.float32)
    scene = open_scene(str(write_hdr("a.exr", pixels)), mean_luminance_cd_m2=20.0)
    view = scene.view_for(45, None, 40.0)
    assert (view.width_px, view.height_px) == (45, 30)
    smaller = np.asarray(scene.frame(0.0, view, Head(), (Eye.LEFT,)).rgb_cd_m2[0])
    own = np.asarray(scene.frame(0.0, scene.view_for(None, None, 40.0), Head(), (Eye.LEFT,)).rgb_cd_m2[0])
    np.testing.assert_allclose(smaller.mean(axis=(1, 2)), own.mean(axis=(1, 2)), rtol=1e-5)


def test_another_aspect_is_refused_with_the_fitting_one(write_hdr: Write) -> None:
    scene = open_scene(str(write_hdr("a.exr", grey(1.0, 600, 900))), mean_luminance_cd_m2=None)
    assert scene.view_for(300, 201, 40.0) == View(300, 201, 40.0)
    with pytest.raises(FrameError, match=r"a\.exr is 900×600.*--width 300 --height 200"):
        scene.view_for(300, 210, 40.0)
    with pytest.raises(FrameError, match="would distort"):
        scene.frame(0.0, View(300, 210), Head(), (Eye.LEFT,))


def test_a_folder_plays_in_the_order_of_its_numbers_and_repeats(write_hdr: Write, tmp_path: Path) -> None:
    for number, value in ((2, 2.0), (10, 3.0), (1, 1.0)):
        write_hdr(f"film/frame_{number}.exr", grey(value), whiteLuminance=1.0)
    (tmp_path / "film" / "notes.txt").write_text("not a picture")
    scene = open_scene(str(tmp_path / "film"), mean_luminance_cd_m2=None)
    view = scene.view_for(None, None, 40.0)

    def value_at(t_s: float) -> float:
        return float(scene.frame(t_s, view, Head(), (Eye.LEFT,)).rgb_cd_m2[0, 0, 0, 0])

    assert [value_at(k / FPS) for k in range(7)] == [1, 2, 3, 1, 2, 3, 1]
    assert value_at(1.9 / FPS) == 2
    assert value_at(-1.0) == 1
    assert any("3 pictures" in note for note in scene.notes)


def test_the_first_picture_of_a_folder_scales_all(write_hdr: Write, tmp_path: Path) -> None:
    write_hdr("film/1.exr", grey(2.0))
    write_hdr("film/2.exr", grey(6.0))
    scene = open_scene(str(tmp_path / "film"), mean_luminance_cd_m2=50.0)
    frame = scene.frame(1 / FPS, scene.view_for(None, None, 40.0), Head(), (Eye.LEFT,))
    np.testing.assert_allclose(frame.rgb_cd_m2, 150.0, rtol=1e-5)


def test_a_frame_says_what_was_cleaned_of_its_own_file(write_hdr: Write, tmp_path: Path) -> None:
    write_hdr("film/1.exr", grey(2.0))
    bad = grey(2.0)
    bad[0, 0, 0] = -1
    write_hdr("film/2.exr", bad)
    scene = open_scene(str(tmp_path / "film"), mean_luminance_cd_m2=None)
    view = scene.view_for(None, None, 40.0)
    assert not scene.frame(0.0, view, Head(), (Eye.LEFT,)).cleaned
    assert scene.frame(1 / FPS, view, Head(), (Eye.LEFT,)).cleaned == Cleaned(negative=1)


def test_folders_that_are_no_film_are_refused(write_hdr: Write, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(FrameError, match=r"empty: no \.exr or \.hdr file"):
        open_scene(str(tmp_path / "empty"), mean_luminance_cd_m2=None)
    write_hdr("mixed/1.exr", grey(1.0))
    write_hdr("mixed/2.exr", grey(1.0, 6, 10))
    with pytest.raises(FrameError, match=r"2\.exr is 10×6 pixels and 1\.exr 9×6.*one size"):
        open_scene(str(tmp_path / "mixed"), mean_luminance_cd_m2=None)
