import itertools
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.frame import FrameError
from entoptic.pipeline.scenes.head_path import HEAD_TIME_CONSTANT_S, follow, open_head_path
from entoptic.pipeline.scenes.scene import Head


def table(folder: Path, text: str) -> str:
    path = folder / "head.csv"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_still_ignores_everything() -> None:
    assert open_head_path("still").step(9.0, 0.1, Head(5, 5, 5), (20.0, 3.0)) == Head()


def test_look_around_starts_ahead_is_slow_and_ignores_order() -> None:
    path = open_head_path("look-around")
    heads = [path.step(k / 100, 0.01, Head(), None) for k in range(6000)]
    assert heads[0] == Head()
    assert max(abs(head.yaw_deg) for head in heads) < 28
    assert max(abs(head.pitch_deg) for head in heads) < 5
    speeds = [math.dist(a, b) * 100 for a, b in itertools.pairwise(heads)]
    assert max(speeds) < 15
    assert path.step(12.34, -5.0, Head(9, 9, 9), None) == heads[1234]


def test_table_is_linear_between_its_rows_and_held_beyond_them(tmp_path: Path) -> None:
    path = open_head_path(table(tmp_path, "t_s,yaw_deg,pitch_deg,roll_deg\n0,0,0,0\n2,10,-4,1\n\n3,10,0,0\n"))
    assert path.step(-1, 0, Head(), None) == Head()
    assert path.step(1.0, 0, Head(), None) == Head(5.0, -2.0, 0.5)
    assert path.step(2.0, 0, Head(), None) == Head(10.0, -4.0, 1.0)
    assert path.step(99.0, 0, Head(), None) == Head(10.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1"),
        ("t,yaw\n0,0\n", "line 1: the columns must be t_s,yaw_deg,pitch_deg,roll_deg"),
        ("t_s,yaw_deg,pitch_deg,roll_deg\n", "no row"),
        ("t_s,yaw_deg,pitch_deg,roll_deg\n0,0,0\n", "line 2"),
        ("t_s,yaw_deg,pitch_deg,roll_deg\n0,0,0,0,0\n", "line 2"),
        ("t_s,yaw_deg,pitch_deg,roll_deg\n0,0,0,0\n1,nan,0,0\n", "line 3.*finite"),
        ("t_s,yaw_deg,pitch_deg,roll_deg\n0,0,left,0\n", "line 2.*numbers"),
        ("t_s,yaw_deg,pitch_deg,roll_deg\n1,0,0,0\n1,0,0,0\n", "line 3.*does not come after"),
        ("t_s,yaw_deg,pitch_deg,roll_deg\n0,0,91,0\n", "line 2.*within ±90"),
    ],
)
def test_bad_table_is_refused_with_its_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(FrameError, match=says):
        open_head_path(table(tmp_path, text))


def test_table_that_is_no_text_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "head.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FrameError, match=r"head\.csv.*no readable CSV"):
        open_head_path(str(tmp_path / "head.csv"))


def test_unknown_path_names_what_there_is() -> None:
    with pytest.raises(FrameError, match=r'"nowhere".*"look-around", "gaze"'):
        open_head_path("nowhere")


def test_follower_covers_63_percent_in_its_time_constant() -> None:
    head = follow(Head(0, 0, 8), 10.0, -5.0, HEAD_TIME_CONSTANT_S)
    left = math.exp(-1)
    assert head == pytest.approx((10 * (1 - left), -5 * (1 - left), 8 * left))


@given(st.floats(-170, 170), st.floats(-170, 170), st.floats(-80, 80), st.floats(0, 10), st.floats(0, 10))
def test_two_steps_are_one_of_their_sum(
    yaw: float, azimuth: float, elevation: float, first: float, then: float
) -> None:
    head = Head(yaw, 2, 1)
    once = follow(head, azimuth, elevation, first + then)
    twice = follow(follow(head, azimuth, elevation, first), azimuth, elevation, then)
    # Exactly opposite, either way round is the shorter one and a rounding decides.
    if abs(abs(azimuth - yaw) - 180) > 1e-6:
        assert twice == pytest.approx(once, abs=1e-9)


def test_follower_takes_the_shorter_way_round() -> None:
    assert follow(Head(170, 0, 0), -170.0, 0.0, 1e9).yaw_deg == pytest.approx(190.0)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "dt_s"), [(10.0, 0.0, 0.0), (10.0, 0.0, -1.0), (math.nan, 0, 1), (0, math.inf, 1)]
)
def test_follower_holds_when_time_or_gaze_is_of_no_use(azimuth: float, elevation: float, dt_s: float) -> None:
    assert follow(Head(1, 2, 3), azimuth, elevation, dt_s) == Head(1, 2, 3)


def test_gaze_path_holds_while_gaze_is_unknown() -> None:
    path = open_head_path("gaze")
    assert path.step(0.0, 0.1, Head(1, 2, 3), None) == Head(1, 2, 3)
    assert path.step(0.0, 1e9, Head(1, 2, 3), (20.0, 5.0)) == pytest.approx((20.0, 5.0, 0.0))
