"""Frames that were rendered once are rendered again to the bit, whatever happened in between."""

import contextlib
import dataclasses
import json
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av
import msgspec
import numpy as np
import pytest
import structlog
from PIL import Image

from entoptic import __version__
from entoptic.pipeline import Display, Encoding, FrameError, RenderState
from entoptic.pipeline.budget import SHIPPED, Cost
from entoptic.pipeline.optics.ocular_dynamics import SaccadeImpulse
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.pipeline.sinks.video_parts import Part
from entoptic.services.config import Eyes, Save, ViewConfig
from entoptic.services.ipc.messages import LatencyMs
from entoptic.services.process import Stop
from entoptic.services.rendering import Rendering
from entoptic.services.results import finish as takes
from entoptic.services.results import kept
from entoptic.services.results.frames import Results
from entoptic.services.results.render_log import Begun, FrameRecord, Record, RenderLog, RenderLogError, begin
from entoptic.services.results.tally import Reception
from entoptic.services.session.again import render
from entoptic.services.session.differences import Differences
from entoptic.services.session.watch import Work
from entoptic.services.session_config import EYES, view_of
from entoptic.services.settings import Settings
from entoptic.services.worker.checkpoint import Checkpoint, Keeper
from entoptic.services.worker.recording import WorkerRecording
from entoptic.tracker_bridge.wire import Direction, EyeState, OneEyeState, Phase

FPS = 20.0
LEFT_OUT = ["acuity", "night_colour", "rod_noise"]  # each takes seconds to compile
VIEW = ViewConfig(width_px=32, height_px=24, fov_deg=90.0, fps=FPS, eyes=Eyes.BOTH, head="still")
SAVE = frozenset({Save.VIDEO})
RECEPTION = Reception(0, 0, 0, 0, {})


def settings(**plan: Any) -> Settings:
    return msgspec.convert(
        {"plan": plan | {"leave_out": LEFT_OUT}, "afterimage": {"on": True}, "adaptation": {"bleaching": "rushton"}},
        Settings,
    )


def state(k: int) -> EyeState:
    one = OneEyeState(Phase.TRACKING, 3.0 + 0.1 * (k % 4), 3.0, 1.0, 0.9 if k % 5 else 0.3, None)
    return EyeState(k, k * 10**7, one, one, Direction(k % 7 - 3.0, -1.0, k * 10**7))


class Session:
    """What a live worker does, without its clock."""

    def __init__(self, perception: Settings) -> None:
        self.rendering = Rendering(open_scene(VIEW.scene), view_of(VIEW), EYES[VIEW.eyes], perception)
        self.t_s = 0.0

    def frames(self, results: Results, numbers: list[int]) -> None:
        for frame in numbers:
            t_s, head = frame / FPS, Head(frame / 3, 1.0, 0.0)
            saccade_impulses = (SaccadeImpulse(3.0, 1.0, 0.01),) if frame % 4 == 0 else ()
            seen = None if frame % 9 == 8 else state(frame)
            rendered = self.rendering.render(frame, t_s, t_s - self.t_s, head, seen, saccade_impulses)
            timings = tuple(rendered.perceived.timings)
            self.rendering.correct(timings)
            record = FrameRecord(frame, t_s, t_s - self.t_s, head, seen, saccade_impulses, 0, timings)
            self.t_s = t_s
            results.add(rendered, record)
            results.note(rendered, LatencyMs(1.0, 2.0, 3.0) if frame % 2 else None)

    def checkpoint(self) -> Checkpoint:
        return Checkpoint(
            written_ns=time.monotonic_ns(), view=VIEW, zero_ns=1, frame=0, t_s=self.t_s, dropped=0, head=Head(),
            perception=self.rendering.perception, costs=self.rendering.costs, state=self.rendering.kept_memory,
        )  # fmt: skip


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames left out, a take that begins in mid-session, other settings in its middle, a crash, and what went on."""
    root = tmp_path_factory.mktemp("takes")
    folder = root / "take"
    folder.mkdir()
    log = structlog.get_logger()
    session = Session(settings())
    with contextlib.ExitStack() as nothing:
        (root / "before").mkdir()
        session.frames(
            nothing.enter_context(Results(root / "before", begin(VIEW, session.rendering, live=True), SAVE)),
            [0, 1],
        )
    results = Results(folder, begin(VIEW, session.rendering, live=True, zero_s=2 / FPS), SAVE)
    session.frames(results, [2, 3, 6])
    changed = settings(budget_ms=3.0)
    session.rendering.perception = changed
    results.perceive(changed)
    session.frames(results, [7, 8, 9])
    keeper = Keeper(root / "checkpoint", log)
    keeper.write(session.checkpoint())
    session.frames(results, [10, 12])
    # The worker is killed: nothing is closed, the last record and the last row are torn.
    for name in ("render_log.msgpack", "plan.csv"):
        with (folder / name).open("ab") as file:
            file.write(b"\x87\xa2" if name.endswith(".msgpack") else b"13,0.5")
    remembered = keeper.read(VIEW)
    assert remembered is not None
    anew = Session(remembered.perception)
    anew.rendering.costs, anew.rendering.memory, anew.t_s = remembered.costs, remembered.state, remembered.t_s
    with Results(folder, begin(VIEW, anew.rendering, live=True, zero_s=2 / FPS), SAVE) as results:
        anew.frames(results, [40, 41, 42])
    takes.write_summary(results.summary(RECEPTION, None), folder)
    return folder


def test_a_take_is_rendered_again_to_the_bit(take: Path, tmp_path: Path) -> None:
    digests = [record.sha256 for record in RenderLog(take / "render_log.msgpack") if isinstance(record, FrameRecord)]
    assert len(set(digests)) == 11
    assert str(rendered_again(take, tmp_path, SAVE)) == "all frames are the same"
    summary = json.loads((tmp_path / "worker.json").read_text())
    assert (summary["frames"], summary["dropped_frames"]) == (11, 30)
    assert bytes.fromhex(summary["perceived_sha256"]) == digests[-1]


def rendered_again(before: Path, out: Path, save: frozenset[Save] = frozenset()) -> Differences:
    return render(before, out, save, None, Stop(), Work())


def test_a_frame_that_is_another_is_named(take: Path, tmp_path: Path) -> None:
    """The order of the eyes' gaze matters to every frame after it."""
    shutil.copytree(take, tmp_path / "other")
    rewrite(tmp_path / "other", turned_at(9))
    (tmp_path / "new").mkdir()
    differences = rendered_again(tmp_path / "other", tmp_path / "new")
    assert differences.first == 9
    assert not differences.kept
    assert "frames differ from frame 9 on; by how much is not known" in str(differences)
    with pytest.raises(RenderLogError, match="name another folder"):
        rendered_again(take, take)


def rewrite(folder: Path, change: Callable[[Record], Record]) -> None:
    render_log = RenderLog(folder / "render_log.msgpack")
    records = [change(record) for record in (render_log.begun, *render_log)]
    (folder / "render_log.msgpack").write_bytes(b"".join(kept.encode(record) for record in records))


def turned_at(frame: int) -> Callable[[Record], Record]:
    """The head is turned further in one frame, which so is another."""
    return lambda record: (
        msgspec.structs.replace(record, head=Head(record.frame / 3 + 2.0, 1.0, 0.0))
        if isinstance(record, FrameRecord) and record.frame == frame
        else record
    )


@pytest.fixture(scope="module")
def pictured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames that are kept as pictures too."""
    folder, session = tmp_path_factory.mktemp("pictured"), Session(settings())
    with Results(folder, begin(VIEW, session.rendering, live=False), frozenset({Save.PNG}), frames=4) as results:
        session.frames(results, [0, 1, 2, 3])
    return folder


@pytest.mark.parametrize(
    ("wrote", "promised", "as_promised"),
    [
        ({}, "0 at most is promised", False),
        ({"machine": "an abacus"}, "rendered on an abacus, here", False),
        ({"program": "0.0.0"}, f"rendered by version 0.0.0, this is {__version__}; nothing is promised", True),
    ],
)
def test_the_largest_difference_is_that_of_the_pictures(
    pictured: Path, tmp_path: Path, wrote: dict[str, str], promised: str, as_promised: bool
) -> None:
    shutil.copytree(pictured, tmp_path / "other")
    rewrite(tmp_path / "other", turned_at(2))
    rewrite(
        tmp_path / "other",
        lambda record: msgspec.structs.replace(record, **wrote) if isinstance(record, Begun) else record,
    )
    (tmp_path / "new").mkdir()
    differences = rendered_again(tmp_path / "other", tmp_path / "new", frozenset({Save.PNG}))
    apart = np.array(
        [
            np.asarray(Image.open(tmp_path / "new" / "frames" / f"00000{k}.png"), np.int64)
            - np.asarray(Image.open(pictured / "frames" / f"00000{k}.png"), np.int64)
            for k in range(4)
        ]
    )
    largest, found = np.abs(apart).max(), differences.largest
    assert largest > 1
    assert not apart[:2].any()
    assert (differences.first, differences.kept) == (2, as_promised)
    assert found is not None
    assert found.code_values == largest
    channel = ("red", "green", "blue").index(found.channel)
    assert abs(apart[found.frame, found.y_px, found.x_px, channel]) == largest
    assert found.values == np.count_nonzero(apart[found.frame])
    assert f"{largest} code values, {found.channel} at x {found.x_px}, y {found.y_px} of frame" in str(differences)
    assert promised in str(differences)


def test_another_machine_may_round_otherwise(pictured: Path, tmp_path: Path) -> None:
    """By one code value, here in one pixel of a picture that was kept."""
    shutil.copytree(pictured, tmp_path / "other")
    path = tmp_path / "other" / "frames" / "000003.png"
    codes = np.array(Image.open(path))
    codes[5, 7, 1] += 1 if codes[5, 7, 1] < 255 else -1
    Image.fromarray(codes).save(path)

    def otherwise(record: Record) -> Record:
        if isinstance(record, FrameRecord) and record.frame == 3:
            return msgspec.structs.replace(record, sha256=b"another")
        return msgspec.structs.replace(record, machine="an abacus") if isinstance(record, Begun) else record

    rewrite(tmp_path / "other", otherwise)
    (tmp_path / "new").mkdir()
    differences = rendered_again(tmp_path / "other", tmp_path / "new")
    assert differences.kept
    assert "is 1 code value, green at x 7, y 5 of frame 3, of which 1 of 4608 values differ" in str(differences)
    assert "1 at most is promised" in str(differences)


def test_a_take_is_finished_into_one_film(take: Path, tmp_path: Path) -> None:
    shutil.copytree(take, tmp_path / "take")
    done = takes.finish(tmp_path / "take")
    assert done["film"] == "perceived.mp4"
    assert done["worker"]["frames"] == 11
    assert done["settings_changed_s"] == [0.25]
    assert done["restarted_s"] == [1.9]
    assert done["film_begins_s"] == 0.0
    assert done["perception"]["plan"]["budget_ms"] is None
    assert not list((tmp_path / "take").glob("perceived-*"))
    with av.open(str(tmp_path / "take" / "perceived.mp4")) as film:
        times = [round(float(frame.pts * frame.time_base) * FPS) for frame in film.decode(video=0)]
    assert times[0] == 0
    assert times[-3:] == [38, 39, 40]
    # Again, and without the last words of anybody: the same figures.
    (tmp_path / "take" / "worker.json").unlink()
    anew = takes.finish(tmp_path / "take")
    assert anew["worker"]["frames"] == 11
    assert anew["worker"]["perceived_sha256"] == done["worker"]["perceived_sha256"]
    assert anew["worker"]["reception"] is None
    assert any("last word is missing" in note for note in anew["folder_notes"])


def test_what_does_not_fit_into_the_film_stays_whatever_is_done_again(take: Path, tmp_path: Path) -> None:
    folder = tmp_path / "take"
    shutil.copytree(take, folder)
    other = Part(folder / "perceived-7.mp4", 64, 24, FPS, Display(encoding=Encoding.HDR10), 50)
    other.write(np.zeros((24, 64, 3), np.uint16), 50)
    other.close()
    apart = (folder / "perceived-7.mp4").read_bytes()
    parts = {path.name: path.read_bytes() for path in folder.glob("perceived-*.mp4")}
    done = takes.finish(folder)
    film = (folder / "perceived.mp4").read_bytes()
    assert (folder / "perceived_apart-7.mp4").read_bytes() == apart
    assert (
        "perceived_apart-7.mp4 is not in the film: it begins at 2.5 s and is of another form." in done["folder_notes"]
    )
    anew = takes.finish(folder)
    assert (anew["film"], anew["folder_notes"]) == (done["film"], done["folder_notes"])
    # Ended by force while the parts were removed: what is still there may be all that there is.
    for name, data in parts.items():
        (folder / name).write_bytes(data)
    again = takes.finish(folder)
    assert (folder / "perceived.mp4").read_bytes() == film
    assert {path.name: path.read_bytes() for path in folder.glob("perceived-*.mp4")} == parts
    assert any("perceived-7.mp4 was left as it is" in note for note in again["folder_notes"])


def test_a_frame_whose_row_was_lost_counts(take: Path, tmp_path: Path) -> None:
    """A worker that is killed between a frame's record and its row."""
    shutil.copytree(take, tmp_path / "take")
    plan = tmp_path / "take" / "plan.csv"
    plan.write_bytes(plan.read_bytes()[:-20])
    for word in (True, False):
        if not word:
            (tmp_path / "take" / "worker.json").unlink()
        worker = takes.finish(tmp_path / "take")["worker"]
        assert (worker["frames"], worker["dropped_frames"]) == (11, 30)


def test_an_old_last_word_is_not_believed(take: Path, tmp_path: Path) -> None:
    shutil.copytree(take, tmp_path / "take")
    session = Session(settings())
    with Results(tmp_path / "take", begin(VIEW, session.rendering, live=True), SAVE):
        assert not (tmp_path / "take" / "worker.json").exists()


def test_rows_are_whole_and_say_the_latency(take: Path) -> None:
    header, *rows = (take / "plan.csv").read_text().splitlines()
    assert [int(row.split(",")[0]) for row in rows] == [2, 3, 6, 7, 8, 9, 10, 12, 40, 41, 42]
    assert header.endswith("sample_to_state_ms,state_to_frame_ms,frame_to_sink_ms")
    assert rows[1].endswith("1.00,2.00,3.00")
    assert rows[0].endswith(",,,")


def leaves(value: Any) -> list[Any]:
    if isinstance(value, tuple):
        return [leaf for one in value for leaf in leaves(one)]
    if isinstance(value, msgspec.Struct):
        return [leaf for name in value.__struct_fields__ for leaf in leaves(getattr(value, name))]
    if dataclasses.is_dataclass(value):
        return [leaf for field in dataclasses.fields(value) for leaf in leaves(getattr(value, field.name))]
    return [value]


def test_what_eyes_remember_comes_back_to_the_bit(take: Path) -> None:
    living = {"lens": True, "microfluctuations": True, "vitreous": True}
    few = {"ocular_dynamics": living, "gratings": 0, "particles": 20, "cornea_cells": 0}
    perception = msgspec.convert({"observer": few, "afterimage": {"on": True}}, Settings)
    session = Session(perception)
    rendered = session.rendering.render(0, 0.0, 0.0, Head(), state(1), (SaccadeImpulse(5.0, 2.0, 0.0),))
    rendered = session.rendering.render(1, 0.05, 0.05, Head(), state(2), ())
    before = dataclasses.replace(rendered.perceived.state, reusable={})
    after: RenderState = kept.decoder(RenderState).decode(kept.encode(before))
    assert any(isinstance(one, np.ndarray) for one in leaves(before))
    assert len(before.memories.afterimage) == 2
    for one, other in zip(leaves(before), leaves(after), strict=True):
        assert type(one) is type(other) or isinstance(one, float), (one, other)
        assert np.asarray(one == other).all()
    assert {name: (choice.level, choice.fade) for name, choice in before.choices.items()} == {
        name: (choice.level, choice.fade) for name, choice in after.choices.items()
    }


def test_the_scenes_time_counts_where_a_frame_was_made() -> None:
    session = Session(settings())
    rendering = session.rendering
    rendering.costs = SHIPPED.beside_scene(Cost(1.0, 0.0))
    rendered = rendering.render(0, 0.0, 0.0, Head(), state(1), ())
    (scene,) = [timing for timing in rendered.timings if timing.effect == "scene"]
    assert (scene.level, scene.milliseconds) == ("whole", rendered.scene_ms)
    assert scene.megapixels == pytest.approx(2 * 32 * 24 / 1e6)
    assert rendered.total_ms == pytest.approx(rendered.scene_ms + sum(rendered.perceived.milliseconds.values()))
    rendering.correct([scene._replace(milliseconds=1000.0)])
    assert rendering.costs.scene_ms(1.0) > 1.1
    on_show = dataclasses.replace(rendered, reuses_frame=True)
    assert all(timing.effect != "scene" for timing in on_show.timings)


def test_a_checkpoint_of_no_use_is_ignored(tmp_path: Path) -> None:
    session, path = Session(settings()), tmp_path / "checkpoint"
    with structlog.testing.capture_logs() as said:
        keeper = Keeper(path, structlog.get_logger())
        assert keeper.read(VIEW) is None
        assert said == []
        keeper.write(session.checkpoint())
        assert keeper.read(VIEW) is not None
        data = path.read_bytes()
        assert keeper.read(msgspec.structs.replace(VIEW, fps=30.0)) is None
        for broken in (b"", data[: len(data) // 2], b"\xc1" * 50, b"{}", msgspec.msgpack.encode({"entoptic": 1})):
            path.write_bytes(broken)
            assert keeper.read(VIEW) is None
        keeper.write(msgspec.structs.replace(session.checkpoint(), written_ns=2**62))
        assert keeper.read(VIEW) is None
    assert [one["event"] for one in said] == ["checkpoint ignored"] * 7
    assert "another scene" in said[0]["why"]
    assert "before this machine" in said[-1]["why"]


def test_moments_that_are_none_are_refused_by_name(take: Path, tmp_path: Path) -> None:
    path = tmp_path / "render_log.msgpack"
    data = (take / "render_log.msgpack").read_bytes()
    with pytest.raises(RenderLogError, match="No such file"):
        RenderLog(path)
    for broken in (b"", b"\x93\x01\x02\x03", b"PK\x03\x04" * 20, data[:40], b"\xc1" + data):
        path.write_bytes(broken)
        with pytest.raises(RenderLogError, match=r"render_log\.msgpack"):
            list(RenderLog(path))
    path.write_bytes(data + data)
    with pytest.raises(RenderLogError, match="two files in one"):
        list(RenderLog(path))


def test_every_cut_leaves_whole_frames(take: Path, tmp_path: Path) -> None:
    path = tmp_path / "render_log.msgpack"
    data = (take / "render_log.msgpack").read_bytes()
    whole = RenderLog(take / "render_log.msgpack")
    count = len(list(whole))
    assert whole.whole_bytes == len(data)
    assert whole.note is None
    for cut in range(1, 400, 7):
        path.write_bytes(data[:-cut])
        render_log = RenderLog(path)
        left = len(list(render_log))
        assert left < count
        assert (render_log.note is None) == (render_log.whole_bytes == len(data) - cut)


def test_a_take_whose_folder_is_gone_ends_and_says_so(tmp_path: Path) -> None:
    session = Session(Settings())
    recording = WorkerRecording(structlog.get_logger())
    folder = tmp_path / "take"
    folder.mkdir()
    recording.begin(str(folder), 0, begin(VIEW, session.rendering, live=True), SAVE, RECEPTION)
    rendered = session.rendering.render(0, 0.0, 0.0, Head(), None, ())
    recording.add(rendered, FrameRecord(0, 0.0, 0.0, Head(), None, (), 0))
    recording.note(rendered, None)
    recording.check()
    assert recording.runs
    shutil.rmtree(folder)
    recording.check()
    assert not recording.runs
    assert recording.problem is not None
    assert str(folder) in recording.problem.what
    assert recording.end(RECEPTION, None) is None
    with pytest.raises((OSError, FrameError)):
        recording.begin(str(folder), 0, begin(VIEW, session.rendering, live=True), SAVE, RECEPTION)
    folder.mkdir()
    recording.begin(str(folder), 0, begin(VIEW, session.rendering, live=True), SAVE, RECEPTION)
    assert recording.problem is None
    assert recording.end(RECEPTION, 1.0) is not None
    assert json.loads((folder / "worker.json").read_text())["frames"] == 0
    assert takes.finish(folder)["film"] is None


def test_costs_come_back() -> None:
    session = Session(settings())
    session.rendering.correct([*session.rendering.render(0, 0.0, 0.0, Head(), None, ()).perceived.timings])
    assert session.rendering.costs != SHIPPED
    checkpoint = session.checkpoint()
    again: Checkpoint = kept.decoder(Checkpoint).decode(kept.encode(checkpoint))
    assert (again.costs.pace, again.costs.own) == (checkpoint.costs.pace, checkpoint.costs.own)
    assert again.costs.ms("glare", "half", 1.0) == checkpoint.costs.ms("glare", "half", 1.0)
