"""`entoptic render --until`: the light after any effect."""

import sys
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from entoptic.pipeline import EFFECTS, EyePose, Frame, FrameError, Observer, Planning, light_after, perceive
from entoptic.pipeline.display_light import seen_peak_cd_m2
from entoptic.pipeline.effects.effect import Domain
from entoptic.pipeline.frame import Display
from entoptic.pipeline.sinks.images import write_exr
from entoptic.services import cli

EVERYTHING = Planning(everything=True)
OBSERVER = Observer(particles=100, gratings=20, cornea_cells=300, vitreous_particles=20)


@pytest.fixture
def frame() -> Frame:
    """Dusk with a lamp, none of it a dark grey."""
    random = np.random.default_rng(5)
    rgb = random.uniform(0.02, 0.2, (48, 64, 3))
    rgb[20:22, 30:32] = (900.0, 700.0, 300.0)
    return Frame.from_rgb(rgb.astype(np.float32), 40.0)


def after(effect: str, frame: Frame) -> np.ndarray:
    light, _ = light_after(effect, frame, EyePose(pupil_diameter_mm=5.0), observer=OBSERVER, planning=EVERYTHING)
    return np.asarray(light)


def test_each_effect_starts_from_the_light_that_the_one_before_left(frame: Frame) -> None:
    np.testing.assert_array_equal(after("adaptation", frame), frame.rgb_cd_m2)
    blurred, veiled = after("acuity", frame), after("glare", frame)
    assert np.abs(veiled - np.asarray(frame.rgb_cd_m2)).max() > 1  # of the lamp's 900 cd/m²
    assert np.abs(blurred - veiled).max() > 1e-4
    np.testing.assert_array_equal(after("rod_noise", frame), blurred)  # it is off


def test_after_the_last_one_it_is_what_the_display_sends(frame: Frame) -> None:
    seen = perceive(frame, EyePose(pupil_diameter_mm=5.0), observer=OBSERVER, planning=EVERYTHING)
    display = seen_peak_cd_m2(Display()) * np.asarray(seen.linear)
    np.testing.assert_allclose(after(EFFECTS[-1].name, frame), display, rtol=1e-4, atol=1e-4)


def test_an_effect_that_there_is_not_is_named_beside_those_that_there_are(frame: Frame) -> None:
    with pytest.raises(FrameError, match="blur is no effect: choose one of adaptation, glare, acuity"):
        light_after("blur", frame)


def run(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> object:
    monkeypatch.setattr(sys, "argv", ["entoptic", "render", *arguments])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code


@pytest.mark.parametrize("effect", [effect.name for effect in EFFECTS])
def test_the_command_writes_it_in_cd_m2(
    effect: str, frame: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_exr(Path("dusk.exr"), np.asarray(frame.rgb_cd_m2[0]).transpose(1, 2, 0))
    arguments = ("dusk.exr", "--fov", "40", "--pupil-diameter-mm", "5", "--everything", "--until", effect)
    assert not run(monkeypatch, *arguments, "-o", "light.exr")
    written = oiio.ImageInput.open("light.exr")
    spec, light = written.spec(), written.read_image(oiio.FLOAT)
    assert spec.get_float_attribute("whiteLuminance") == 1
    assert spec.format == oiio.FLOAT
    in_scene = next(one.domain for one in EFFECTS if one.name == effect) is Domain.SCENE
    assert bool(light.max() > 200) is in_scene  # the lamp's light, or the display's peak of 100 cd/m²


def test_the_light_is_no_png(
    frame: Frame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_exr(Path("dusk.exr"), np.asarray(frame.rgb_cd_m2[0]).transpose(1, 2, 0))
    assert run(monkeypatch, "dusk.exr", "--until", "glare")
    assert "name it perceived.exr" in capsys.readouterr().err
