"""What is read from a session's folder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from entoptic.pipeline import EyePose, FrameError, Light, Observer, View
from entoptic.pipeline.sinks.images import write_exr
from entoptic.services.config import StillConfig
from entoptic.services.explain import subject, timeline
from entoptic.services.settings import Settings


class TestSession:
    def test_a_key_frame_is_what_stood_before_both_eyes(self, session: Path, lamp: np.ndarray) -> None:
        found = subject.from_session(session, None, None)
        assert found.title == "walk, frame 7 at 0.70 s"
        image = lamp.transpose(2, 0, 1) * 7
        np.testing.assert_allclose(np.asarray(found.frame.rgb_cd_m2), [image, image / 2], rtol=1e-6)
        assert found.frame.view.fov_deg == 60.0
        assert found.adapted_cd_m2 == (0.5, 1.5)
        assert [eye.pupil_diameter_mm for eye in found.poses] == [4.0, 5.0]
        assert found.t_s == 0.7
        assert found.settings.observer.age_years == 61.0

    @pytest.mark.parametrize(("wanted", "number"), [(0, 3), (4, 3), (6, 7), (10**9, 7)])
    def test_the_nearest_one_is_taken(self, session: Path, wanted: int, number: int) -> None:
        assert f"frame {number} " in subject.from_session(session, wanted, None).title

    def test_settings_that_are_given_win(self, session: Path) -> None:
        given_ = Settings(observer=Observer(age_years=25.0))
        assert subject.from_session(session, None, given_).settings == given_

    @given(st.floats(-50, 50), st.floats(-50, 50))
    def test_gaze_is_read_back_from_where_it_fell(self, azimuth_deg: float, elevation_deg: float) -> None:
        view = View(400, 300, 104.0)
        x_px, y_px = view.pixel_of(azimuth_deg, elevation_deg)
        row = {"left_gaze_x_px": f"{x_px}", "left_gaze_y_px": f"{y_px}", "left_pupil_diameter_mm": "4"}
        pose = subject._pose(row, "left", view)
        assert (pose.azimuth_deg, pose.elevation_deg) == pytest.approx((azimuth_deg, elevation_deg), abs=1e-9)

    def test_what_is_missing_is_named(self, session: Path) -> None:
        (session / "key_frames" / "000007_scene.exr").unlink()
        with pytest.raises(FrameError, match=r"000007_scene\.exr: the session kept no scene of this frame"):
            subject.from_session(session, 7, None)
        (session / "plan.csv").write_text((session / "plan.csv").read_text(encoding="utf-8").split("\n3,")[0])
        with pytest.raises(FrameError, match=r"plan\.csv has no frame 3"):
            subject.from_session(session, 3, None)
        (session / "key_frames" / "key_frames.json").write_text("[]")
        with pytest.raises(FrameError, match=r"key_frames\.json names no frame"):
            subject.from_session(session, None, None)
        (session / "key_frames" / "key_frames.json").write_text("{")
        with pytest.raises(FrameError, match=r"key_frames\.json cannot be read"):
            subject.from_session(session, None, None)

    def test_settings_that_cannot_be_are_named(self, session: Path) -> None:
        summary = json.loads((session / "summary.json").read_text(encoding="utf-8"))
        summary["config"]["settings"]["observer"]["age_years"] = 500
        (session / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
        with pytest.raises(FrameError, match=r"summary\.json: .*<= 120.*give --settings"):
            subject.from_session(session, None, None)

    def test_only_a_folder_with_a_plan_is_a_session(self, session: Path, tmp_path: Path) -> None:
        assert subject.is_session(str(session))
        assert not subject.is_session(str(tmp_path))
        assert not subject.is_session("night-street")


def test_an_image_is_seen_by_one_eye(tmp_path: Path, lamp: np.ndarray) -> None:
    write_exr(tmp_path / "lamp.exr", lamp)
    still, lamp_file = StillConfig(gaze="1,2", fov_deg=60.0, lights=("5,-2,0.3,LED-B3",)), str(tmp_path / "lamp.exr")
    found = subject.from_image(lamp_file, replace(still, adaptation=0.2), Settings())
    np.testing.assert_allclose(np.asarray(found.frame.rgb_cd_m2)[0], lamp.transpose(2, 0, 1), rtol=1e-6)
    assert (found.adapted_cd_m2, found.poses, found.t_s) == ((0.2,), (EyePose(1.0, 2.0),), None)
    assert any("whiteLuminance" in note for note in found.notes)
    assert found.frame.lights == (Light(5.0, -2.0, 0.3, 0.0, "LED-B3"),)
    assert subject.from_image(lamp_file, still, Settings()).adapted_cd_m2 is None
    for odd, said in ((replace(still, gaze="up"), "--gaze 'up'"), (replace(still, lights=("1,2",)), "--light '1,2'")):
        with pytest.raises(FrameError, match=said):
            subject.from_image(lamp_file, odd, Settings())


class TestTimeline:
    def test_levels_follow_one_another_without_a_gap(self, session: Path) -> None:
        found = timeline.read(session / "plan.csv")
        of_acuity = [span for span in found.spans if span.effect == "acuity"]
        assert [(s.level, s.begin_s, s.end_s) for s in of_acuity] == [
            ("on", 0.0, 0.4),
            ("skipped", 0.4, 0.8),
            ("on", 0.8, pytest.approx(1.0)),
        ]
        assert [s.reason for s in of_acuity] == ["why acuity at 0", "why acuity at 4", "why acuity at 8"]
        assert all(s.begin_s == 0 and s.end_s == pytest.approx(1.0) for s in found.spans if s.effect != "acuity")
        assert [(change.effect, change.begin_s) for change in found.changes] == [("acuity", 0.4), ("acuity", 0.8)]

    def test_times_are_those_of_perceiving(self, session: Path) -> None:
        found = timeline.read(session / "plan.csv")
        assert not {"scene", "total"} & set(found.ms)
        assert found.ms["measure"].tolist() == [1.0] * 10
        assert found.ms["acuity"].tolist() == [2.0] * 4 + [0.0] * 4 + [2.0] * 2

    def test_one_frame_is_a_session_and_none_is_not(self, session: Path) -> None:
        lines = (session / "plan.csv").read_text(encoding="utf-8").splitlines()
        (session / "plan.csv").write_text("\n".join(lines[:2]), encoding="utf-8")
        assert {span.end_s for span in timeline.read(session / "plan.csv").spans} == {1.0}
        (session / "plan.csv").write_text(lines[0], encoding="utf-8")
        with pytest.raises(FrameError, match="holds no frame"):
            timeline.read(session / "plan.csv")
