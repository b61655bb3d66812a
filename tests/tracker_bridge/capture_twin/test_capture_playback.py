import itertools
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from entoptic.tracker_bridge.capture_twin.playback import Ahead, Moment, open_playback
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.source import SourceError
from entoptic.tracker_bridge.sources.pupil_core.recorder import write_recording
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings

SIMULATED = SimulatedSettings(rate_hz=30.0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "a"
    write_recording(SimulatedEyes(SimulatedSettings(seconds=2.0, rate_hz=50.0)), folder)
    return folder


def times(moments: Iterator[Moment] | list[Moment]) -> list[float]:
    return [message["timestamp"] for moment in moments for message in (*moment.pupils, *moment.gazes)]


def test_simulated_eyes_go_on_over_the_minute_with_other_eyes() -> None:
    moments = open_playback("simulated", simulated=SIMULATED).moments
    some = list(itertools.islice(moments, 30 * 62))
    assert [moment.at_s for moment in some] == pytest.approx([at / 30 for at in range(30 * 62)])
    assert times(some[-5:]) == pytest.approx([s.at_s for s in some[-5:] for _ in (*s.pupils, *s.gazes)])
    assert some[30 * 61].pupils[1]["diameter_3d"] != some[30 * 1].pupils[1]["diameter_3d"]
    again = open_playback("simulated", simulated=SIMULATED).moments
    assert list(itertools.islice(again, 20)) == some[:20]


def test_a_recording_plays_once(recording: Path) -> None:
    moments = list(open_playback(str(recording), simulated=SIMULATED).moments)
    topics = Counter(message["topic"] for moment in moments for message in (*moment.pupils, *moment.gazes))
    assert topics["pupil.0.2d"] == topics["pupil.1.2d"] == topics["pupil.0.3d"] == topics["pupil.1.3d"] == 100
    assert topics["gaze.3d.01."] == 100
    assert moments[0].at_s == 0.0
    assert moments[-1].at_s == pytest.approx(1.98)


def test_a_recording_that_loops_has_times_that_go_on(recording: Path) -> None:
    once = list(open_playback(str(recording), simulated=SIMULATED).moments)
    looped = open_playback(str(recording), simulated=SIMULATED, loop=True).moments
    thrice = list(itertools.islice(looped, 3 * len(once)))
    assert thrice[: len(once)] == once
    at = [moment.at_s for moment in thrice]
    assert at == sorted(at)
    period_s = thrice[len(once)].at_s
    assert 1.98 < period_s < 2.05
    assert times(thrice[-3:]) == pytest.approx([time_s + 2 * period_s for time_s in times(once[-3:])])


def test_an_export_and_a_table_play_too(tmp_path: Path) -> None:
    table, column_map = tmp_path / "eyes.csv", tmp_path / "map.toml"
    table.write_text("t,d\n0.0,4.0\n0.1,4.1\n")
    column_map.write_text(
        'name = "mine"\ntime = { column = "t", unit = "s" }\n[right]\ndiameter = { column = "d", unit = "mm" }\n'
    )
    moments = list(open_playback(str(table), simulated=SIMULATED, table_map=column_map).moments)
    assert [moment.at_s for moment in moments] == [0.0, 0.1]
    assert [message["topic"] for message in moments[0].pupils] == ["pupil.0.2d", "pupil.0.3d"]
    assert moments[1].pupils[1]["diameter_3d"] == 4.1


def test_a_bad_source_is_named(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="nothing does not exist"):
        open_playback(str(tmp_path / "nothing"), simulated=SIMULATED)


@pytest.mark.shared_data
def test_a_real_recording_is_played_in_its_own_order(shared: Callable[[str], Path]) -> None:
    path = shared("eye/pupil_core/recording_000")
    moments = list(open_playback(str(path), simulated=SIMULATED).moments)
    at = [moment.at_s for moment in moments]
    assert at == sorted(at)
    stamps = [moment.pupils[0]["timestamp"] for moment in moments]
    theirs = np.load(path / "pupil_timestamps.npy")
    assert (np.diff(theirs) < 0.0).any()
    assert stamps == (theirs - theirs.min()).tolist()
    assert all(moment.at_s >= moment.pupils[0]["timestamp"] for moment in moments)


def test_moments_are_prepared_ahead() -> None:
    moments = [Moment(at / 10) for at in range(1000)]
    ahead = Ahead(iter(moments))
    taken = []
    while (moment := ahead.wait()) is not None:
        taken.append(moment)
    assert taken == moments
    assert ahead.ended
    assert ahead.take() is None
    ahead.close()


def test_what_goes_wrong_in_preparing_is_raised_where_it_is_taken() -> None:
    def broken() -> Iterator[Moment]:
        yield Moment(0.0)
        raise SourceError("the file is gone")

    ahead = Ahead(broken())
    assert ahead.wait() == Moment(0.0)
    with pytest.raises(SourceError, match="the file is gone"):
        ahead.wait()
    ahead.close()


def test_an_endless_preparation_can_be_closed() -> None:
    ahead = Ahead(Moment(at / NS_PER_S) for at in itertools.count())
    assert ahead.wait() == Moment(0.0)
    ahead.close()
