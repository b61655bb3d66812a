"""A person's own curve and its file, the display as it is seen, and what settings refuse."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from entoptic.pipeline.display_light import black_share, reflected_cd_m2, viewer_cd_m2
from entoptic.pipeline.effects import tone
from entoptic.pipeline.effects.tone import Operator, Tone, own_curve
from entoptic.pipeline.frame import Display, FrameError

POINTS = [(-3.0, 0.002), (-1.0, 0.03), (0.0, 0.18), (1.0, 0.7), (1.5, 0.7), (3.0, 1.0)]
ABSOLUTE, RELATIVE = "log10_cd_m2", "log10_of_adapted"


def curve_file(folder: Path, header: str = ABSOLUTE, points: list[tuple[float, float]] = POINTS) -> Tone:
    path = folder / f"{header}.csv"
    path.write_text(f"{header}, share\n\n" + "".join(f"{log}, {share}\n" for log, share in points))
    return Tone(Operator.CURVE, curve=str(path))


def shown(cd_m2: np.ndarray | list[float], adapted: float, tone_: Tone) -> np.ndarray:
    rgb = np.broadcast_to(np.asarray(cd_m2, np.float32), (1, 3, 1, len(cd_m2)))
    return np.asarray(tone.show(rgb, [adapted], [adapted], tone_, Display()), np.float64)[0, 1, 0]


def test_a_curve_passes_through_its_points_and_runs_monotonically_between(tmp_path: Path) -> None:
    logs, shares = np.array(POINTS).T
    assert shown(10**logs, 7.0, curve_file(tmp_path)) == pytest.approx(shares, abs=2e-4)
    between = np.linspace(-3, 3, 5000)
    image = shown(10**between, 7.0, curve_file(tmp_path))
    assert image == pytest.approx(PchipInterpolator(logs, shares)(between), abs=2e-4)
    assert np.diff(image).min() >= -3e-7  # float32's last place


def test_a_curve_falls_to_black_below_its_first_point_and_stays_above_its_last(tmp_path: Path) -> None:
    tone_ = curve_file(tmp_path)
    assert shown([0, 1e-6, 5e-4, 1e-3], 1.0, tone_) == pytest.approx([0, 2e-6, 1e-3, 2e-3], rel=1e-5)
    assert shown([1e3, 1e6, 1e12], 1.0, tone_) == pytest.approx([1, 1, 1], rel=1e-5)
    assert tone.full_cd_m2(1.0, 1.0, tone_, Display()) == pytest.approx(1e3)


def test_a_curve_is_of_the_adapted_luminance_if_its_header_says_so(tmp_path: Path) -> None:
    relative, absolute = curve_file(tmp_path, RELATIVE), curve_file(tmp_path)
    light = np.geomspace(1e-4, 1e4, 100)
    assert shown(light * 0.05, 0.05, relative) == pytest.approx(shown(light, 3.0, absolute), rel=1e-4)
    assert np.array_equal(shown(light, 0.05, absolute), shown(light, 3.0, absolute))
    assert tone.full_cd_m2(0.05, 1.0, relative, Display()) == pytest.approx(50)


def test_a_curve_that_never_is_full_says_so(tmp_path: Path) -> None:
    assert tone.full_cd_m2(1, 1, curve_file(tmp_path, points=[(0, 0), (1, 0.9)]), Display()) == np.inf


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "first line"),
        ("a,b\n0,0\n1,1\n", "first line must be `log10_cd_m2,share` or `log10_of_adapted,share`"),
        ("log10_cd_m2,share\n0,0\n", "1 points: give two or more"),
        ("log10_cd_m2,share\n0,0\n1,x\n", "line 3: give two numbers"),
        ("log10_cd_m2,share\n0,0\n1,1,1\n", "line 3: give two numbers"),
        ("log10_cd_m2,share\n0,0\n1,1.5\n", "line 3: .*share in 0…1"),
        ("log10_cd_m2,share\n0,0\nnan,1\n", "line 3: .*−12…12"),
        ("log10_cd_m2,share\n0,0\n0,1\n", "line 3: .*must rise"),
        ("log10_cd_m2,share\n0,0.5\n1,0.4\n", "line 3: .*must not fall"),
    ],
)
def test_a_file_that_is_no_rising_curve_is_refused_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(text)
    with pytest.raises(FrameError, match=says):
        own_curve.read_curve(str(path))


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "picture.csv").write_bytes(bytes(range(255)))
    for name, says in (
        ("none.csv", "No such file or directory; give the path of a CSV file"),
        ("picture.csv", "cannot be read as CSV"),
        (".", "; give the path of a CSV file"),
    ):
        with pytest.raises(FrameError, match=rf"tone curve .*: .*{says}"):
            own_curve.read_curve(str(tmp_path / name))


def test_a_curve_and_its_file_go_together() -> None:
    for table in ({"operator": "curve"}, {"curve": "a.csv"}, {"operator": "aces", "curve": "a.csv"}):
        with pytest.raises(msgspec.ValidationError, match="curve"):
            msgspec.convert(table, Tone)
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({"white": 0.1}, Tone)
    assert msgspec.convert({"operator": "reinhard", "hue": "xyy", "white": 4}, Tone).white == 4


def test_the_surround_is_reflected_and_adapted_to() -> None:
    """A screen that scatters back 1 % returns 2 cd/m² of a surround of 200: black and white rise by as much."""
    display = Display(100.0, 0.5, 200.0)
    assert reflected_cd_m2(display) == pytest.approx(2)
    assert black_share(display) == pytest.approx(2.5 / 102)
    assert viewer_cd_m2(display) == 200
    assert viewer_cd_m2(Display(100.0)) == 50
    assert black_share(Display(100.0, 0.5)) == 0.005


def test_before_a_bright_surround_a_threshold_is_shown_larger() -> None:
    """The viewer's own threshold has risen."""
    grey = np.full((1, 3, 1, 1), 0.01, np.float32)
    dark, bright = (
        np.asarray(tone.show(grey, [0.1], [0.1], Tone(Operator.WARD), display))[0, 0, 0, 0]
        for display in (Display(), Display(surround_cd_m2=1000.0))
    )
    assert bright * 110 / (dark * 100) == pytest.approx(10 ** (3 - 1.255) / 3.0879, rel=1e-4)


def test_a_display_whose_black_is_its_white_is_refused() -> None:
    with pytest.raises(FrameError, match="black must be darker"):
        black_share(Display(1.0, 1.0))
