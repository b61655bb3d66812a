"""The result file, and what it makes of diameters."""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.tracker_bridge import pupil_map
from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.dropout import DropoutFilter
from entoptic.tracker_bridge.events import Event
from entoptic.tracker_bridge.pupil_map import EyeMap, MappedWindow, PupilMap, PupilMapError, Use
from entoptic.tracker_bridge.samples import Eye, EyeState, OneEyeState, Phase, PupilSample
from entoptic.tracker_bridge.source import Tick

WINDOW = MappedWindow("white", 0.0, 4.0, 8.0, 71.25, 0.93, 0.0123)


def made(**changes: Any) -> PupilMap:
    plain = PupilMap(
        format=1,
        program="entoptic 0",
        date="2026-01-02T03:04:05+00:00",
        source='A tracker "7"\n\x7f é ☃ 𝄞',
        display="page in a browser",
        protocol="robust",
        unit="px",
        use=Use.MAP,
        display_uncertainty_ms=0.4,
        right=EyeMap(70.0, 150.0, 2.1, (WINDOW, WINDOW)),
        left=EyeMap(60.0, 120.0, 2.4),
    )
    return msgspec.structs.replace(plain, **changes)


def state(pupil_diameter_mm: float | None, measured_mm: float | None = None) -> EyeState:
    one = OneEyeState(Phase.TRACKING, pupil_diameter_mm, measured_mm, 1.0, 1.0, None)
    return EyeState(0, 0, one, one, None)


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_a_map_comes_back_from_its_file(tmp_path: Path) -> None:
    for one in (made(), made(left=None, display_uncertainty_ms=None)):
        assert pupil_map.read(write(tmp_path / "map.toml", pupil_map.text(one))) == one


@given(st.text(), st.floats(0.001, 5000.0), st.floats(0.01, 5000.0))
def test_any_map_comes_back(source: str, white: float, span: float) -> None:
    one = made(source=source, left=EyeMap(white, white + span, 1.0), right=None)
    back = msgspec.toml.decode(pupil_map.text(one), type=PupilMap)
    assert back.source == source
    assert back.left is not None
    assert back.left.white == pytest.approx(white, abs=1e-4)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("format = 1", "format = 2", "format"),
        ('unit = "px"', 'unit = "inch"', "unit"),
        ('use = "map"', 'use = "check"', "pixels are no diameter"),
        ('use = "map"', 'use = "map"\ncolour = "red"', "colour"),
        ("white = 70.0000", "white = 170.0", "must be less than black"),
        ("white = 70.0000", "white = nan", "white"),
        ("black = 150.0000", "black = inf", "black"),
        ("white = 70.0000", "white = -1.0", "white"),
        ("white = 70.0000", "white = 'wide'", "white"),
        ("[right]", "[right", r"map\.toml"),
    ],
)
def test_a_broken_file_is_refused_by_name(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = pupil_map.text(made())
    assert old in text
    with pytest.raises(PupilMapError, match=said) as error:
        pupil_map.read(write(tmp_path / "map.toml", text.replace(old, new, 1)))
    assert "map.toml" in str(error.value)
    assert "make a new one" in str(error.value)


def test_a_file_without_eyes_or_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PupilMapError, match="neither"):
        pupil_map.read(write(tmp_path / "map.toml", pupil_map.text(made(left=None, right=None))))
    with pytest.raises(PupilMapError, match="entoptic calibrate"):
        pupil_map.read(tmp_path / "nowhere.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PupilMapError, match=r"bytes\.toml"):
        pupil_map.read(tmp_path / "bytes.toml")


@given(st.floats(0.1, 400.0), st.sampled_from(Eye))
def test_pixels_become_two_to_eight_millimetres(px: float, eye: Eye) -> None:
    """Through both halves: 2 mm before white, 8 mm before black, a line between them, and no further."""
    one = made()
    sample = one.apply(PupilSample(0, eye, None, 1.0, diameter_px=px))
    measured = one.of(eye)
    assert measured is not None
    expected = 2.0 + 6.0 * (px - measured.white) / (measured.black - measured.white)
    shown = one.map_state(state(sample.pupil_diameter_mm, sample.pupil_diameter_mm)).of(eye)
    assert shown.pupil_diameter_mm == pytest.approx(min(max(expected, 2.0), 8.0))
    # What was measured stays recognisable as nonsense.
    assert shown.measured_mm == pytest.approx(expected)


def test_what_the_filter_sees_before_the_white_screen_is_a_pupil() -> None:
    assert made().apply(PupilSample(0, Eye.RIGHT, None, 1.0, diameter_px=70.0)).pupil_diameter_mm == 2.5


def test_millimetres_are_checked_or_mapped() -> None:
    sample = PupilSample(0, Eye.RIGHT, 4.0, 1.0)
    eye = EyeMap(3.0, 6.0, 2.0)
    checked = made(unit="mm", use=Use.CHECK, right=eye, left=eye)
    assert checked.apply(sample) is sample
    assert checked.map_state(before := state(4.0, 4.0)) is before
    mapped = made(unit="mm", right=eye, left=eye)
    assert mapped.apply(sample) is sample
    assert [mapped.map_state(state(mm)).right.pupil_diameter_mm for mm in (2.5, 3.0, 4.0, 6.0, 7.0)] == [2, 2, 4, 8, 8]


def test_what_is_missing_stays_missing() -> None:
    one = made(left=None)
    sample = PupilSample(0, Eye.RIGHT, None, 0.0)
    assert one.apply(sample).pupil_diameter_mm is None
    assert one.map_state(state(None)).right.pupil_diameter_mm is None
    assert one.apply(PupilSample(0, Eye.RIGHT, 4.0, 1.0)).pupil_diameter_mm is None
    left = PupilSample(0, Eye.LEFT, None, 1.0, diameter_px=70.0)
    assert one.apply(left) is left
    assert one.map_state(state(4.0)).left.pupil_diameter_mm == 4.0


def test_a_pupil_a_little_wider_than_before_the_black_screen_is_kept() -> None:
    """Why there are two halves: mapped before the filter it would be refused, or a lid's pinhole clamped to a pupil."""
    one = made(unit="mm", right=EyeMap(3.0, 6.0, 2.0))

    def phases(pupil_diameter_mm: float) -> set[Phase]:
        pupil = DropoutFilter()
        return {pupil.step(PupilSample(k * 5_000_000, Eye.RIGHT, pupil_diameter_mm, 1.0)).phase for k in range(100)}

    assert phases(6.6) == {Phase.TRACKING}
    assert one.map_state(state(6.6)).right.pupil_diameter_mm == 8.0
    assert Phase.TRACKING not in phases(one.mapped_mm(Eye.RIGHT, 6.6))


def test_a_map_that_is_found_while_a_stream_runs_is_used_from_the_next_item_on_and_is_no_lid() -> None:
    chain = Chain(live=True)
    records: list[EyeState | Event] = []
    for at in range(800):
        if at == 400:
            chain.use(made())
        t_ns = 10**9 + at * 5_000_000
        # 4 mm of the tracker's own are 2 mm by the map.
        for item in (PupilSample(t_ns, Eye.LEFT, 4.0, 1.0, 1.0, diameter_px=60.0), Tick(t_ns)):
            records += chain.step(item)
    states = [record for record in records if isinstance(record, EyeState)]
    assert records == states
    assert {one.left.phase for one in states[-399:]} == {Phase.TRACKING}
    assert states[399].left.pupil_diameter_mm == pytest.approx(4.0)
    assert [one.left.pupil_diameter_mm for one in states[-399:]] == pytest.approx([2.0] * 399)
