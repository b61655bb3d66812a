import json
import re
from pathlib import Path
from typing import Any

import msgspec
import pytest

from entoptic.atomic_file import write_json
from entoptic.services import recording as takes
from entoptic.services.ipc.status import BridgeStatus, Gap, WorkerStatus
from entoptic.services.report.plots import NOT_TRACKING
from entoptic.services.results import session_file
from entoptic.services.results.finish import finish
from entoptic.services.session_config import SessionConfig, open_session
from entoptic.services.settings import Settings
from entoptic.tracker_bridge.wire import Phase


def test_every_phase_in_which_a_pupil_is_not_tracked_is_shaded() -> None:
    assert set(NOT_TRACKING) == {phase.value for phase in Phase} - {Phase.TRACKING.value}


STATES = """sequence,t_s,gaze_azimuth_deg,gaze_elevation_deg,\
right_phase,right_pupil_diameter_mm,right_measured_mm,left_phase,left_pupil_diameter_mm,left_measured_mm
0,0.0,1.0,2.0,tracking,3.0,3.0,tracking,3.0,3.0
1,0.5,1.0,2.0,tracking,3.0,3.0,tracking,3.1,3.1
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A take without frames, whose host was ended by force while the worker was away."""
    made = takes.make(tmp_path / "take", open_session(SessionConfig()))
    takes.note_meanwhile(made, 0, [Gap("worker", 2 * 10**9, None, "it was killed")])
    (made / "states.csv").write_text(STATES)
    gaps = [{"from_s": 0.5 * k, "to_s": 0.5 * k + 0.2} for k in range(1, 20)]
    write_json(
        made / "bridge.json", {"states": 2, "gaps": gaps, "problem": {"code": "disk full", "what": "the disk is full"}}
    )
    return made


def test_a_report_says_what_happened(folder: Path) -> None:
    finished = takes.finish(folder)
    assert takes.draw_report(finished) is None
    page = (finished / "report.html").read_text()
    for words in (
        "interrupted", takes.CUT_OFF.what, "worker away from 2.0 s on: it was killed",
        "the disk is full", "from 0.5 to 0.7 s", "and 7 times more",
    ):  # fmt: skip
        assert words in page
    # Done again it says the same, and beside earlier results it is not done at all.
    takes.finish(finished)
    assert json.loads((finished / "summary.json").read_text())["problems"][0]["code"] == takes.CUT_OFF.code
    finished.rename(folder)
    finished.mkdir()
    with pytest.raises(takes.RecordingFolderError, match="take is there already: move it away"):
        takes.finish(folder, replaces=False)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("states.csv", STATES.replace("3.1,3.1", "3.1,3.x"), "states.csv, row 2: left_measured_mm is '3.x'"),
        ("states.csv", "t_s,else\n1,2\n", "not whole.*left_measured_mm"),
        ("summary.json", '{"problems": ', "summary.json is damaged"),
        ("plan.csv", "frame,t_s\n0,now\n", "plan.csv, row 1: t_s is 'now'"),
    ],
)
def test_a_damaged_file_is_named(folder: Path, name: str, text: str, said: str) -> None:
    finished = takes.finish(folder)
    (finished / name).write_text(text)
    problem = takes.draw_report(finished)
    assert problem is not None
    assert problem.what.startswith(f"No report in {finished}: ")
    assert re.search(said, problem.what)


def test_a_take_has_the_settings_and_the_pupil_map_of_its_own_time(tmp_path: Path) -> None:
    opened = open_session(SessionConfig())
    (tmp_path / "curve.csv").write_text("log10_cd_m2,share\n-2,0.0\n2,1.0\n")
    (tmp_path / "map.toml").write_text("calibrated since")
    settings: dict[str, Any] = {
        "tone": {"operator": "curve", "curve": str(tmp_path / "curve.csv")},
        "observer": {"age_years": 71.0},
    }
    now = takes.as_of_now(
        opened,
        WorkerStatus(settings=msgspec.convert(settings, Settings)),
        BridgeStatus(pupil_map=str(tmp_path / "map.toml")),
    )
    folder = takes.make(tmp_path / "take", now)
    assert takes.keep_inputs(folder, now.config) is None
    assert "age_years = 71.0" in (folder / "settings.toml").read_text()
    kept = session_file.read(folder)
    assert msgspec.convert(settings, Settings) == kept.config.settings == now.config.settings
    assert {one.what for one in kept.inputs} == {"tone curve", "pupil map"}
    assert (
        takes.summary_of(kept, takes.HostNotes(), finish(folder))["config"]["settings"]["observer"]["age_years"] == 71.0
    )
    # Those of the start where nobody says anything else.
    assert takes.as_of_now(opened, None, BridgeStatus()) == opened


def test_what_cannot_be_kept_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    takes.refuse(tmp_path / "deep" / "take")
    assert list((tmp_path / "deep").iterdir()) == []
    (tmp_path / "stale.partial").mkdir()
    with pytest.raises(
        takes.RecordingFolderError, match=r"stale\.partial is there already: finish it with `entoptic report"
    ):
        takes.refuse(tmp_path / "stale")
    (tmp_path / "file").touch()
    with pytest.raises(takes.RecordingFolderError, match="cannot be written: File exists"):
        takes.refuse(tmp_path / "file" / "take")
