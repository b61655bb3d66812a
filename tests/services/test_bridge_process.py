"""The bridge's process, but for its being one: what it leaves behind, and how it ends where it cannot."""

import contextlib
import json
import resource
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import structlog

from entoptic.services.bridge import process as bridge
from entoptic.services.process import Stop
from entoptic.services.process_config import BridgeConfig
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceError, SourceInfo, Tick

MS, S = 1_000_000, 1_000_000_000
ANY = "tcp://127.0.0.1:*"


class Tracker:
    """A second at 200 Hz, from 1000 s on."""

    def __init__(self, *, live: bool = False) -> None:
        self.info = SourceInfo("made up", 1000 * S, None if live else 1001 * S, live=live)
        self.is_open = False
        self.taken = 0

    def samples(self) -> Iterator[Item]:
        self.is_open = True
        try:
            for t_ns in range(1000 * S, 1001 * S, 5 * MS):
                self.taken += 1
                yield PupilSample(t_ns, Eye.LEFT, 4.0, 1.0)
                yield GazeSample(t_ns, None, 100.0 if t_ns == 1000 * S else 1.0, 0.0, 1.0)
            if self.info.live:
                yield Tick(t_ns)
        finally:
            self.is_open = False


Run = Callable[..., list[dict[str, object]]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    def one(source: Tracker, **changes: object) -> list[dict[str, object]]:
        monkeypatch.setattr(bridge, "open_eyes", lambda *given, **more: source)
        monkeypatch.setattr(bridge, "open_live_eyes", lambda *given, **more: source)
        with structlog.testing.capture_logs() as said:
            bridge.run(BridgeConfig(**changes), Stop(), structlog.get_logger())
        return list(said)

    return one


@pytest.mark.parametrize("live", [False, True])
def test_it_says_in_the_end_what_it_published(run: Run, live: bool) -> None:
    assert [line for line in run(Tracker(live=live)) if line["event"] == "ended"] == [
        {"event": "ended", "states": 200, "stalls": 0, "late_samples": 0, "log_level": "info"}
    ]


def test_a_recording_is_as_long_as_what_it_holds_and_what_it_lacks_is_said(run: Run, tmp_path: Path) -> None:
    said = run(Tracker(), record=str(tmp_path / "kept"))
    info = json.loads((tmp_path / "kept" / "info.player.json").read_text())
    assert info["duration_s"] == pytest.approx(0.995)
    assert [line["directions_beyond_90_deg_left_out"] for line in said if line["event"] == "recording"] == [1]


@contextlib.contextmanager
def no_file_over(count: int) -> Iterator[None]:
    """A disk with little room, as this process sees it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (count, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_recording_that_cannot_be_written_is_one_clear_error_and_frees_the_tracker(run: Run, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(SourceError, match=r"file exists already"):
        run(Tracker(), record=str(tmp_path / "file"))
    source = Tracker()
    with no_file_over(2000), pytest.raises(SourceError, match="File too large"):
        run(source, record=str(tmp_path / "kept"))
    assert 2 < source.taken < 200
    assert not source.is_open


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"live": True, "sees": "tcp://127.0.0.1:9"}, "leave --sees out"),
        ({"sees": "tcp://127.0.0.1:9"}, "--sees is for a live session: add --live"),
        ({"begun_ns": 1}, "--begun-ns is for a live session"),
        ({"live": True, "screens": ANY}, "--screens and --answers are of use together"),
        ({"live": True, "reader_keys": "keys/"}, "--reader-keys are for the worker"),
    ],
)
def test_what_goes_with_other_options_alone_is_said(run: Run, given: dict[str, object], said: str) -> None:
    with pytest.raises(SourceError, match=said):
        run(Tracker(live=True), **given)
