"""The frame in its variants, the page and the command."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure
from matplotlib.text import Text
from msgspec.structs import replace
from typer.testing import CliRunner

from entoptic.pipeline import EyePose, Frame, FrameError, Planning, RenderState, perceive
from entoptic.pipeline.sinks.images import write_exr
from entoptic.services.commands.explain import explain as command
from entoptic.services.explain import page, panels, plan_panels, timeline
from entoptic.services.explain.subject import Subject, refuse_unwritable
from entoptic.services.explain.variants import Explained, Touch, code_values, explain
from entoptic.services.settings import Settings


class TestVariants:
    def test_the_plan_is_what_perceiving_gives(self, subject: Subject, explained: Explained) -> None:
        bare = perceive(subject.frame, subject.poses, state=RenderState((0.3,)), effects=subject.settings)
        np.testing.assert_array_equal(explained.planned.image, bare.image)
        assert [step.level for step in explained.planned.plan] == [step.level for step in bare.plan]

    def test_acuity_touches_the_dark_stripes_alone(self, explained: Explained) -> None:
        change = explained.touched["acuity"].change[0]
        assert (change[:, 27:-3] >= 1).mean() > 0.5
        assert (change[:, :20] == 0).all()

    def test_what_was_left_out_is_the_difference(self, subject: Subject, explained: Explained) -> None:
        without = replace(subject.settings, plan=Planning(leave_out=frozenset({"glare"})))
        found = explain(dataclasses.replace(subject, settings=without))
        assert "glare" not in found.touched
        assert found.difference[0, 7:15, 5:13].max() > 20  # light around the lamp
        assert np.abs(found.difference).max() == explained.touched["glare"].largest

    def test_under_a_budget_the_cheapest_is_explained(self, subject: Subject) -> None:
        tight = replace(subject.settings, plan=Planning(budget_ms=1.0))
        found = explain(dataclasses.replace(subject, settings=tight))
        assert not found.touched
        assert np.abs(found.difference).max() > 20
        assert np.abs(found.difference).max() <= found.planned.plan.bound_code_values + 1

    def test_it_is_no_more_than_the_plan_says(self, explained: Explained) -> None:
        # Both are rounded.
        assert np.abs(explained.difference).max() <= explained.planned.plan.bound_code_values + 1

    def test_the_difference_is_of_the_channel_that_differs_most(self, explained: Explained) -> None:
        apart = code_values(explained.full) - code_values(explained.planned)
        assert (np.abs(explained.difference) == np.abs(apart).max(-1)).all()
        assert np.isclose(apart, explained.difference[..., None]).any(-1).all()

    def test_where_everything_is_on_nothing_differs(self) -> None:
        rows = np.where(np.arange(48) % 6 < 3, 0.005, 0.015)
        frame = Frame.from_rgb(np.broadcast_to(rows[:, None, None], (48, 40, 3)), 60.0)
        found = explain(Subject("dark", frame, (EyePose(),), Settings(), (0.01,)))
        assert {"acuity", "night_colour"} <= set(found.touched)
        assert found.touched["night_colour"].share > 0.9
        assert not {"tone", "adaptation"} & set(found.touched)

    def test_a_touch_counts_whole_code_values(self) -> None:
        touch = Touch(np.array([[[0.0, 0.4], [1.0, 7.0]]]))
        assert (touch.largest, touch.share) == (7.0, 0.5)


@given(
    arrays.arrays(np.float64, st.tuples(st.integers(1, 23), st.integers(1, 23)), elements=st.floats(-300, 300)),
    st.integers(1, 23),
)
def test_of_a_reduced_image_the_greatest_remain(image: np.ndarray, longer_px: int) -> None:
    small = panels.extreme(image, longer_px)
    block = -(-max(image.shape) // longer_px)
    assert max(small.shape) <= longer_px
    for row in range(small.shape[0]):
        for column in range(small.shape[1]):
            part = image[row * block : (row + 1) * block, column * block : (column + 1) * block]
            assert abs(small[row, column]) == np.abs(part).max()
            assert small[row, column] in part


def texts(figure: Figure | SubFigure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


class TestPage:
    def test_it_says_all_that_was_planned_and_measured(
        self, tmp_path: Path, subject: Subject, explained: Explained, drawn: list[Figure]
    ) -> None:
        page.write(tmp_path / "page.png", subject, explained)
        said = " ".join(texts(drawn[0]))
        for step in explained.planned.plan:
            assert step.effect.replace("_", " ") in said
            assert all(word in said for word in step.reason.split())
        for touch in explained.touched.values():
            assert f"{touch.share:.1%} of pixels, by {touch.largest:.0f} at most" in said
        assert f"full minus planned: {np.abs(explained.difference).max():.0f} (bound" in said
        image = oiio.ImageBuf(str(tmp_path / "page.png")).spec()
        assert image.width == page.WIDTH_IN * page.DPI
        assert image.height < 3000

    def test_nothing_is_written_beyond_its_edges(
        self, tmp_path: Path, subject: Subject, explained: Explained, drawn: list[Figure]
    ) -> None:
        page.write(tmp_path / "page.png", subject, explained)
        renderer = FigureCanvasAgg(drawn[0]).get_renderer()
        for text in drawn[0].findobj(Text):
            if text.get_text() and text.get_visible():
                box = text.get_window_extent(renderer)
                assert box.x1 <= page.WIDTH_IN * page.DPI + 1, text.get_text()

    def test_a_frame_without_any_light_can_be_drawn(self, tmp_path: Path) -> None:
        frame = Frame.from_rgb(np.zeros((48, 40, 3), np.float32), 60.0)
        subject = Subject("black", frame, (EyePose(),), Settings())
        page.write(tmp_path / "page.png", subject, explain(subject))
        assert (tmp_path / "page.png").stat().st_size > 5000

    def test_a_session_has_its_levels_its_times_and_why_they_changed(
        self, tmp_path: Path, session: Path, subject: Subject, explained: Explained, drawn: list[Figure]
    ) -> None:
        page.write(tmp_path / "page.png", subject, explained, timeline.read(session / "plan.csv"))
        said = texts(drawn[0])
        assert {"0.40 s", "acuity → skipped", "why acuity at 4", "0.80 s", "acuity → on"} <= set(said)
        assert "level of each effect" in said

    def test_long_reasons_take_more_lines(self, explained: Explained) -> None:
        step = dataclasses.replace(explained.planned.plan["glare"], reason="word " * 60)
        assert plan_panels.table_lines([step]) == 1 + 3

    @pytest.mark.parametrize(("name", "message"), [("a.jpg", r"name it .*a\.png"), ("no/a.png", "there is no folder")])
    def test_a_path_that_cannot_be_is_refused(self, tmp_path: Path, name: str, message: str) -> None:
        with pytest.raises(FrameError, match=message):
            refuse_unwritable(tmp_path / name)


class TestCommand:
    @staticmethod
    def run(*arguments: str) -> object:
        app = typer.Typer()
        app.command()(command)
        result = CliRunner().invoke(app, arguments)
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        assert result.exit_code == 0, result.output
        return result

    def test_an_image(self, tmp_path: Path, lamp: np.ndarray) -> None:
        write_exr(tmp_path / "lamp.exr", lamp)
        out = tmp_path / "out.png"
        self.run(str(tmp_path / "lamp.exr"), "--gaze", "3,-2", "--adaptation", "0.3", "--fov", "60", "-o", str(out))
        assert oiio.ImageBuf(str(out)).spec().width == 1700

    def test_a_session(self, session: Path, tmp_path: Path) -> None:
        out = tmp_path / "out.png"
        self.run(str(session), "--frame", "2", "--budget-ms", "20", "--set", "observer.age_years=70", "-o", str(out))
        assert oiio.ImageBuf(str(out)).spec().height > 1000

    def test_a_frame_number_needs_a_session(self, tmp_path: Path) -> None:
        with pytest.raises(FrameError, match="--frame 3: night-street is no session"):
            self.run("night-street", "--frame", "3", "-o", str(tmp_path / "out.png"))
