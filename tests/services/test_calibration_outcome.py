"""What works a pupil calibration out beside a live bridge, where it fails."""

import time
from pathlib import Path

import pytest

from entoptic.services.calibration import outcome as pupil_outcome
from entoptic.services.calibration.outcome import Concluding, Job, Outcome
from entoptic.services.calibration.run import Recorded
from entoptic.tracker_bridge.calibration import Stage, robust
from entoptic.tracker_bridge.samples import Eye


def outcome_of(concluding: Concluding) -> Outcome:
    deadline_s = time.monotonic() + 60.0
    while (outcome := concluding.outcome) is None:
        assert time.monotonic() < deadline_s
        time.sleep(0.01)
    concluding.end()
    return outcome


def test_one_that_hangs_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pupil_outcome, "_WITHIN_S", 0.05)
    recorded = Recorded(robust(), (Eye.LEFT,), Stage.FINISHED, (), [])
    job = Job(recorded, str(tmp_path / "out.toml"), "nobody", "none", None, map_mm=False, plot_failed=True)
    outcome = outcome_of(Concluding(job))
    assert outcome.found is None
    assert [(one.name, "longer" in one.detail) for one in outcome.problems] == [("not worked out", True)]
    assert list(tmp_path.iterdir()) == []
