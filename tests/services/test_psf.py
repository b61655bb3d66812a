"""`entoptic psf` part by part: profiles, pictures, sheets, films, the observer's file."""

import csv
import dataclasses
import io
import math
from pathlib import Path

import av
import numpy as np
import OpenImageIO as oiio
import pytest
from clear_pupil import airy
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from rich.console import Console

from entoptic.pipeline import GlareModel, Iris, Observer
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.observer import ScatterShares
from entoptic.pipeline.optics import analytic, radial
from entoptic.pipeline.optics.aperture import Pose
from entoptic.services.psf import film, plots, profile, results, sheets
from entoptic.services.psf.picture import SCALE, Scale, displayed, radiance
from entoptic.services.psf.subject import Subject
from entoptic.services.settings import Settings, SettingsError, changed, load, refuse_unwritable, write

CLEAR = Observer(
    particles=0,
    gratings=0,
    cornea_cells=0,
    vitreous_particles=0,
    scatter=ScatterShares(cornea=0.0, lens=0.0, vitreous=0.0),
)
AIRY = Subject(CLEAR, Pose(5.0))
EYE = Subject(Observer(seed=2), Pose(6.0), wavelengths=16)
CIE = Subject(Observer(), Pose(5.0), GlareModel.CIE, wavelengths=4)


def core_within(subject: Subject, nm: float, deg: np.ndarray) -> np.ndarray:
    """The share of the core's light within angles: all light but the formula's, which goes on beyond the core."""
    formula = radial.encircled(lambda at: subject.formula(at, nm), deg)
    return (profile.encircled(subject, nm)(deg) - formula) / subject.core_share(nm)


def test_a_clear_eye_is_airys() -> None:
    deg = np.geomspace(0.001, 0.3, 60)
    expected = radial.encircled(lambda at: airy(at, 5.0, 575.0), deg)
    # What Airy's pattern has beyond the field is the core's too.
    np.testing.assert_allclose(core_within(AIRY, 575.0, deg), expected, atol=0.004)


@pytest.mark.parametrize("model", GlareModel)
def test_all_light_lies_within_90_degrees(model: GlareModel) -> None:
    subject = dataclasses.replace(EYE, model=model)
    for nm in (400.0, 700.0):
        within = profile.encircled(subject, nm)(profile.THETA_DEG)
        assert within[0] == 0
        assert (np.diff(within) >= 0).all()
        # SPE's terms add up to 0.9994 (equations 8).
        assert within[-1] == pytest.approx(1, abs=1e-3 if model is GlareModel.SPE else 1e-5)


def whole_profile(nm: float) -> np.ndarray:
    return profile.density(profile.encircled(EYE, nm), *profile._ring_edges())


def test_the_rings_of_a_profile_hold_all_light() -> None:
    low, high = profile._ring_edges()
    solid_angle = 2 * math.pi * (np.cos(np.radians(low)) - np.cos(np.radians(high)))
    assert (whole_profile(550.0) * solid_angle).sum() == pytest.approx(1, abs=1e-5)
    assert (low <= profile.THETA_DEG).all()
    assert (high >= profile.THETA_DEG).all()


@pytest.mark.parametrize("nm", [450.0, 568.0, 650.0])
def test_the_halo_lies_at_three_degrees_and_grows_with_the_wavelength(nm: float) -> None:
    halo = (profile.THETA_DEG > 1.8) & (profile.THETA_DEG < 4)
    brightest = profile.THETA_DEG[halo][whole_profile(nm)[halo].argmax()]
    # Rings are 4.6 % apart.
    assert brightest == pytest.approx(3 * nm / 568, rel=0.04)


def test_a_wavelengths_core_is_the_others_scaled() -> None:
    deg = np.array([0.01, 0.1, 1.0, 2.0])
    blue, red = (core_within(EYE, nm, deg * nm / 575) for nm in (450.0, 650.0))
    np.testing.assert_allclose(blue, red, rtol=1e-9)


def test_spencers_corona_and_halo_are_drawn_as_lines_of_the_formulas_light() -> None:
    """SPE 3.2: as dark between as in the kernel that frames get."""
    picture = radiance(dataclasses.replace(EYE, model=GlareModel.SPE, wavelengths=8), 181, 9.0)
    y, x = (np.indices((181, 181)) - 90) / 20
    luminance = np.einsum("c,cyx->yx", LUMINANCE_WEIGHTS, picture)
    for low, high in ((0.9, 1.1), (2.9, 3.1)):
        ring = luminance[(np.hypot(x, y) > low) & (np.hypot(x, y) < high)]
        assert ring.std() > 0.5 * ring.mean()


@pytest.mark.parametrize("model", [GlareModel.WAVE, GlareModel.IJSPEERT, GlareModel.SPE])
def test_picture_and_profile_are_the_same_light(model: GlareModel) -> None:
    subject = dataclasses.replace(EYE, model=model, wavelengths=8)
    picture = radiance(subject, 361, 9.0)
    luminance = np.einsum("c,cyx->yx", LUMINANCE_WEIGHTS, picture)
    deg = (np.arange(361) - 180) / 40
    distance = np.hypot(deg[:, None], deg[None, :])
    for at in (0.3, 1.0, 2.0, 3.0, 4.0):
        ring = (distance > at / 1.1) & (distance < at * 1.1)
        expected = profile.density(profile.luminous(subject), np.array(at / 1.1), np.array(at * 1.1))
        # The ring's edge runs through pixels, 14 of them across the narrowest ring's diameter.
        assert luminance[ring].mean() == pytest.approx(float(expected), rel=0.1 if at < 1 else 0.02)
    assert luminance.min() >= 0


def test_a_picture_is_the_same_however_narrow_its_field() -> None:
    wide, narrow = radiance(EYE, 181, 9.0), radiance(EYE, 41, 9.0 * 41 / 181)
    np.testing.assert_allclose(narrow, wide[:, 70:-70, 70:-70], rtol=1e-4, atol=1e-4)


@given(st.floats(-3, 8))
def test_white_light_is_as_light_as_its_logarithm(exponent: float) -> None:
    code = displayed(np.full((3, 1, 1), 10.0**exponent), Scale(0, 5))
    assert abs(code.astype(float) - 255 * min(max(exponent / 5, 0), 1)).max() <= 0.51


@given(st.tuples(*[st.floats(-0.5, 3.0)] * 3), st.floats(0.0, 5.0))
def test_a_colour_keeps_its_hue_and_its_lightness(rgb: tuple[float, float, float], exponent: float) -> None:
    weights, colour = np.array(LUMINANCE_WEIGHTS), np.array(rgb)
    if (luminance := weights @ colour) < 0.2:
        return
    light = colour / luminance * 10.0**exponent
    code = displayed(light[:, None, None], Scale(0, 5))[0, 0] / 255
    linear = np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    grey = (displayed(np.full((3, 1, 1), 10.0**exponent), Scale(0, 5))[0, 0, 0]) / 255
    grey_linear = grey / 12.92 if grey <= 0.04045 else ((grey + 0.055) / 1.055) ** 2.4
    # Half a code value of each channel is up to 0.5 % of full light.
    assert weights @ linear == pytest.approx(grey_linear, abs=0.01)
    away, shown = colour / luminance - 1, linear - weights @ linear
    assert np.linalg.norm(np.cross(away, shown)) <= 0.02 * max(1.0, float(np.linalg.norm(away)))


@given(st.floats(0.05, 60))
def test_the_ruler_is_a_round_angle_of_good_length(field_deg: float) -> None:
    ruler = plots.ruler_deg(field_deg)
    assert field_deg / 10 <= ruler * 1.001
    assert ruler <= field_deg / 4 * 1.001
    assert float(f"{ruler:.0e}") == pytest.approx(ruler)
    assert plots.ruler_deg(9.0) == 1


def test_a_sheets_pictures_are_there_pixel_for_pixel(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    images = [rng.integers(0, 256, (61, 61, 3)).astype(np.uint8) for _ in range(3)]
    left = iter(images)
    monkeypatch.setattr(sheets, "SIDE_PX", 61)
    monkeypatch.setattr(sheets, "_image", lambda subject: next(left))
    sheets.write(tmp_path / "sheet.png", sheets.Sheet("Title", ((("a", EYE), ("b", EYE)), (("c", EYE),))))
    page = oiio.ImageBuf(str(tmp_path / "sheet.png")).get_pixels(oiio.UINT8)[..., :3]
    first = sheets.TITLE_PX
    second = first + 61 + sheets.CAPTION_PX
    for image, row, column in ((images[0], first, 0), (images[1], first, 1), (images[2], second, 0)):
        x = sheets.GAP_PX + column * (61 + sheets.GAP_PX)
        # The upper half has no ruler.
        np.testing.assert_array_equal(page[row : row + 30, x : x + 61], image[:30])


@pytest.mark.parametrize("name", sheets.SHEETS)
def test_each_sheet_varies_what_it_says(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sheets, "SIDE_PX", 61)
    shown: list[Subject] = []

    def small(subject: Subject, size_px: int, field_deg: float) -> np.ndarray:
        shown.append(subject)
        return np.ones((3, size_px, size_px))

    monkeypatch.setattr(sheets, "radiance", small)
    sheet = sheets.SHEETS[name](EYE)
    captions = [caption for row in sheet.rows for caption, _ in row]
    assert len(captions) == len(set(captions))
    sheets.write(tmp_path / "sheet.jpg", sheet)
    # All could be seen, and no two are alike.
    assert len(set(shown)) == len(shown) == len(captions)
    assert (tmp_path / "sheet.jpg").stat().st_size < 300_000


def test_particles_that_would_hide_all_are_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, drawn: list[Figure]
) -> None:
    monkeypatch.setattr(sheets, "SIDE_PX", 61)
    crowded = dataclasses.replace(CIE, observer=Observer(particle_mm=0.15))
    sheets.write(tmp_path / "sheet.jpg", sheets.particles(crowded))
    captions = [axes.get_xlabel() for axes in drawn[0].axes]
    assert [": too many to see" in caption for caption in captions] == [False, False, True, True]


@given(st.floats(1, 120), st.floats(1, 119))
def test_particles_grow_with_age(own_years: float, age_years: float) -> None:
    observer = Observer(age_years=own_years)
    assert sheets.particles_at(observer, own_years) == observer.particles
    assert sheets.particles_at(observer, age_years) <= sheets.particles_at(observer, age_years + 1) <= 20000


observers = st.builds(
    Observer,
    age_years=st.floats(1, 120),
    iris=st.sampled_from(Iris),
    particles=st.integers(0, 20000),
    particle_mm=st.floats(0.005, 0.5),
    defocus_d=st.floats(-8, 8),
    seed=st.integers(0, 2**62),
)


@given(observers, st.booleans(), st.sampled_from(GlareModel))
def test_saved_settings_are_read_as_they_were(
    tmp_path_factory: pytest.TempPathFactory, observer: Observer, lashes: bool, model: GlareModel
) -> None:
    path = tmp_path_factory.mktemp("observer") / "my_eye.toml"
    changes = {"observer.ocular_dynamics.lashes": lashes, "glare.model": model.value}
    tuned = changed(Settings(observer=observer), changes)
    write(path, tuned)
    assert load(path) == tuned


@pytest.mark.parametrize(
    ("name", "named"), [("my_eye.txt", "TOML"), ("no/my_eye.toml", "no folder"), ("d.toml", "is a")]
)
def test_an_observers_file_must_have_a_place(tmp_path: Path, name: str, named: str) -> None:
    (tmp_path / "d.toml").mkdir()
    with pytest.raises(SettingsError, match=named):
        refuse_unwritable(tmp_path / name)


def test_all_that_is_written_of_an_eye(tmp_path: Path) -> None:
    said = Console(file=io.StringIO(), width=200)
    results.run(CIE, tmp_path / "out", said, size_px=150, field_deg=9.0)
    names = {".entoptic", "encircled.csv", "mtf.csv", "profile.csv", "profiles.png", "psf.png", "pupil_plane.png"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == names
    with (tmp_path / "out" / "profile.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["theta_deg", *(f"{nm}_nm" for nm in range(400, 701, 50)), "luminous_D65"]
    assert (float(rows[0]["theta_deg"]), float(rows[-1]["theta_deg"])) == (0, 90)
    ten = min(rows, key=lambda row: abs(float(row["theta_deg"]) - 10))
    expected = analytic.cie135(np.array(float(ten["theta_deg"])), 30.0, 0.5)
    assert float(ten["550_nm"]) == pytest.approx(float(expected), rel=5e-3)
    assert said.file.getvalue().count("1.00") == len(profile.RATIOS_DEG)  # type: ignore[attr-defined]


def test_the_scale_is_stated_and_follows_the_field() -> None:
    assert str(SCALE) == "0.32 to 3162 sr⁻¹, 4 decades"
    assert results.scale_for(CIE, 9.0) == results.scale_for(EYE, 9.0) == SCALE
    for field_deg in (0.1, 1.0, 60.0):
        scale = results.scale_for(EYE, field_deg)
        code = displayed(radiance(dataclasses.replace(EYE, wavelengths=4), 61, field_deg), scale)
        assert code[0, 30].max() < 128, "its edge is dark"
        assert code[30, 30].min() == 255


@given(st.floats(0, 100))
def test_lids_are_open_but_for_blinks(t_s: float) -> None:
    assert 0 <= film.openness_at(t_s) <= 1
    assert abs(film.openness_at(t_s + 0.001) - film.openness_at(t_s)) < 0.02


def test_a_short_film_has_a_blink() -> None:
    openness = [film.openness_at(k / film.FPS) for k in range(48)]
    assert min(openness) < 0.1
    assert openness.count(1.0) > 36


def test_a_film_and_its_strip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "SIDE_PX", 101)
    monkeypatch.setattr(sheets, "SIDE_PX", 61)
    done: list[tuple[int, int]] = []
    film.write(tmp_path, dataclasses.replace(EYE, wavelengths=4), 0.25, lambda *at: done.append(at))
    assert done == [(k, 6) for k in range(1, 7)]
    with av.open(str(tmp_path / "psf.mp4")) as opened:
        frames = [frame.to_ndarray(format="rgb24") for frame in opened.decode(video=0)]
    assert [frame.shape for frame in frames] == [(102, 102, 3)] * 6
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 4, "nothing moved"
    assert (tmp_path / "psf_film.png").stat().st_size > 0
