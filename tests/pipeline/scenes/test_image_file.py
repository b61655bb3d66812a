from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Cleaned, FrameError
from entoptic.pipeline.scenes.image_file import band_solid_angles, cd_m2_per_unit, read, read_header

Write = Callable[..., Path]
Find = Callable[[str], Path]


def luminance(rgb: np.ndarray) -> np.ndarray:
    return np.tensordot(np.array(LUMINANCE_WEIGHTS, np.float32), rgb, 1)


def random_image(height: int = 6, width: int = 9) -> np.ndarray:
    return np.random.default_rng(0).uniform(0.1, 2.0, (height, width, 3)).astype(np.float32)


def test_pixels_come_as_they_are(write_hdr: Write) -> None:
    pixels = random_image()
    file = read(write_hdr("a.exr", pixels))
    np.testing.assert_array_equal(file.rgb, pixels.transpose(2, 0, 1))
    assert file.rgb.dtype == np.float32
    assert not file.cleaned
    assert file.notes == ()
    assert not file.header.panorama


def test_channels_are_found_by_name(write_hdr: Write) -> None:
    pixels = np.dstack([random_image(), np.zeros((6, 9))])[:, :, [3, 2, 1, 0]]
    file = read(write_hdr("a.exr", pixels, channels=("A", "B", "G", "R")))
    np.testing.assert_array_equal(file.rgb, random_image().transpose(2, 0, 1))


def test_bad_components_are_counted_and_named(write_hdr: Write) -> None:
    pixels = random_image()
    pixels[0, 0] = (-1.0, np.nan, np.inf)
    pixels[1, 1, 0] = -2.0
    file = read(write_hdr("bad.exr", pixels))
    assert file.cleaned == Cleaned(negative=2, nan=1, infinite=1)
    assert "bad.exr: 2 negative, 1 NaN, 1 infinite" in file.notes[0]
    assert np.isfinite(file.rgb).all()
    assert file.rgb.min() == 0
    assert file.rgb[2, 0, 0] == file.rgb.max() == pytest.approx(random_image().max(), rel=0.2)


def test_scale_is_the_mean_asked_for_before_the_header_before_the_default(write_hdr: Write) -> None:
    with_header = read(write_hdr("a.exr", random_image(), whiteLuminance=621.0))
    without = read(write_hdr("b.exr", random_image()))
    scale, sentence = cd_m2_per_unit(with_header, 7.0)
    assert luminance(with_header.rgb).mean() * scale == pytest.approx(7.0, rel=1e-5)
    assert "mean over its pixels" in sentence
    scale, sentence = cd_m2_per_unit(with_header, None)
    assert scale == 621.0
    assert "whiteLuminance" in sentence
    scale, sentence = cd_m2_per_unit(without, None)
    assert luminance(without.rgb).mean() * scale == pytest.approx(100.0, rel=1e-5)
    assert "default" in sentence


def test_mean_of_a_panorama_is_weighted_by_solid_angle(write_hdr: Write) -> None:
    pixels = np.zeros((90, 180, 3), np.float32)
    pixels[:30] = 1.0  # a cap of 60° around the zenith: a quarter of the sphere
    scale, sentence = cd_m2_per_unit(read(write_hdr("a.exr", pixels)), 5.0)
    assert scale == pytest.approx(20.0, rel=1e-4)
    assert "solid-angle mean" in sentence
    assert band_solid_angles(90).sum() == pytest.approx(1.0)


def test_own_chromaticities_become_rec709_with_the_same_luminance(write_hdr: Write) -> None:
    rec2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    grey = np.full((4, 4, 3), 2.0, np.float32)
    file = read(write_hdr("grey.exr", grey, chromaticities=rec2020))
    np.testing.assert_allclose(file.rgb, 2.0, rtol=1e-4)
    green = np.zeros((4, 4, 3), np.float32)
    green[:, :, 1] = 1.0
    file = read(write_hdr("green.exr", green, chromaticities=rec2020))
    # BT.2087's matrix from 2020 to 709, its green column; the negatives lie outside the gamut.
    np.testing.assert_allclose(file.rgb[:, 0, 0], [0.0, 1.1329, 0.0], atol=1e-3)
    assert "32 components outside its gamut" in file.notes[0]


def test_rec709_in_the_header_changes_nothing(write_hdr: Write) -> None:
    rec709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
    file = read(write_hdr("a.exr", random_image(), chromaticities=rec709))
    assert file.notes == ()


def test_chromaticities_without_a_gamut_are_refused(write_hdr: Write) -> None:
    path = write_hdr("a.exr", random_image(), chromaticities=(0.3,) * 8)
    with pytest.raises(FrameError, match=r"a\.exr.*span no colours"):
        read(path)


def test_header_that_says_panorama_is_believed(write_hdr: Write) -> None:
    path = write_hdr("a.exr", random_image(8, 16), textureformat="LatLong Environment")
    assert read_header(path).panorama


@pytest.mark.parametrize(
    ("shape", "attributes", "says"),
    [
        ((8, 20, 3), {"textureformat": "LatLong Environment"}, "20×8.*twice as wide as high"),
        ((8, 16, 1), {"channels": ("Y",)}, "channels are Y, R, G, B missing"),
        ((8, 16, 2), {"channels": ("R", "G")}, "B missing"),
    ],
)
def test_what_is_no_picture_is_refused(
    write_hdr: Write, shape: tuple[int, ...], attributes: dict[str, object], says: str
) -> None:
    path = write_hdr("odd.exr", np.ones(shape, np.float32), **attributes)
    with pytest.raises(FrameError, match=rf"odd\.exr.*{says}"):
        read(path)


def test_missing_foreign_and_broken_files_are_refused(tmp_path: Path, write_hdr: Write) -> None:
    with pytest.raises(FrameError, match=r"none\.exr: no such file"):
        read(tmp_path / "none.exr")
    with pytest.raises(FrameError, match=r"a\.jpg: not a format.*\.exr or \.hdr"):
        read(tmp_path / "a.jpg")
    (tmp_path / "empty.hdr").write_bytes(b"")
    with pytest.raises(FrameError, match=r"empty\.hdr: cannot be read"):
        read(tmp_path / "empty.hdr")
    (tmp_path / "text.hdr").write_text("This is not a picture.\n" * 100)
    with pytest.raises(FrameError, match=r"text\.hdr: cannot be read"):
        read(tmp_path / "text.hdr")


@pytest.mark.parametrize("name", ["cut.exr", "cut.hdr"])
def test_a_file_that_breaks_off_is_refused(tmp_path: Path, write_hdr: Write, name: str) -> None:
    whole = write_hdr(name, random_image(200, 300)).read_bytes()
    for kept in (20, len(whole) // 2, len(whole) - 100):
        (tmp_path / name).write_bytes(whole[:kept])
        with pytest.raises(FrameError, match=rf"{name}.*cannot be read"):
            read(tmp_path / name)


def test_images_without_light_or_number_are_refused(write_hdr: Write) -> None:
    black = read(write_hdr("black.exr", np.zeros((3, 4, 3))))
    with pytest.raises(FrameError, match=r"black\.exr.*is black"):
        cd_m2_per_unit(black, None)
    with pytest.raises(FrameError, match=r"nan\.exr.*no pixel"):
        read(write_hdr("nan.exr", np.full((3, 4, 3), np.nan)))


@pytest.mark.shared_data
@pytest.mark.parametrize(
    ("name", "cleaned", "panorama", "scale"),
    [
        ("openexr_CandleGlass.exr", Cleaned(negative=1107), False, None),
        ("openexr_Tree.exr", Cleaned(), False, 621.0),
        ("pmndrs_sunrise.hdr", Cleaned(), True, None),
        ("pmndrs_night.hdr", Cleaned(), True, None),
        ("pmndrs_lab.hdr", Cleaned(), True, None),
        ("pmndrs_studio.hdr", Cleaned(), True, None),
    ],
)
def test_real_files(shared: Find, name: str, cleaned: Cleaned, panorama: bool, scale: float | None) -> None:
    file = read(shared(f"hdr/{name}"))
    assert file.cleaned == cleaned
    assert file.header.panorama is panorama
    assert np.isfinite(file.rgb).all()
    assert file.rgb.min() >= 0
    if scale is not None:
        assert cd_m2_per_unit(file, None)[0] == scale
    assert any("chromaticities" in note for note in file.notes) is (name == "openexr_Tree.exr")
