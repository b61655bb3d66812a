"""The frames of an earlier session once more, from what they were rendered from: the same to the bit."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from entoptic.atomic_file import write_json
from entoptic.pipeline.scenes import open_scene
from entoptic.services import recording
from entoptic.services.config import Save
from entoptic.services.process import Stop
from entoptic.services.rendering import Rendering
from entoptic.services.results import session_file
from entoptic.services.results.finish import finish, write_summary
from entoptic.services.results.folder import BRIDGE, results_folder
from entoptic.services.results.frames import Results
from entoptic.services.results.render_log import FILE as RENDER_LOG
from entoptic.services.results.render_log import FrameRecord, Perceive, RenderLog, RenderLogError, Resumed
from entoptic.services.results.session_file import SessionFile
from entoptic.services.session.differences import Differences
from entoptic.services.session.watch import SessionError, Work, watch
from entoptic.services.session_config import view_of
from entoptic.services.settings import Settings, changed, files_of

TABLES = ("states.csv", "events.csv", BRIDGE, session_file.FILE, "settings.toml")
"""What the frames change nothing in."""


def run(before: Path, out: Path, save: frozenset[Save], stop: Stop, console: Console) -> bool:
    """Renders the session in a folder again into another one, with a report of its own; says what differs.

    Returns whether that is no more than is promised. Raises SessionError, StoppedError, SessionFileError,
    RenderLogError, ResultsFolderError, and FrameError for a scene that is gone; then no folder is left.
    """
    session = session_file.read(before)
    if not (before / RENDER_LOG).exists():
        raise SessionError(f"{before} holds no {RENDER_LOG}: its frames cannot be rendered again")
    if out.resolve() == before.resolve():
        raise SessionError(f"{out} is that session itself: choose another --out")
    with results_folder(out) as folder:
        for name in TABLES:
            with contextlib.suppress(FileNotFoundError):
                shutil.copyfile(before / name, folder / name)
        if (before / session_file.INPUTS).is_dir():
            shutil.copytree(before / session_file.INPUTS, folder / session_file.INPUTS)
        differences = watch(
            lambda work: render(before, folder, save, session, stop, work),
            stop,
            console,
            "stopped: nothing was written",
        )
        console.print(escape(str(differences)), soft_wrap=True)
        # Gaps and problems are those of what was rendered then.
        write_json(
            folder / recording.SUMMARY, recording.summary_of(session, recording.notes_of(before), finish(folder))
        )
        if (problem := recording.draw_report(folder)) is not None:
            console.print(f"[yellow]![/yellow] {escape(str(problem))}", soft_wrap=True)
    return differences.kept


def render(
    before: Path, out: Path, save: frozenset[Save], session: SessionFile | None, stop: Stop, work: Work
) -> Differences:
    """Renders all frames of a folder into another one, and tells what they differ in.

    Raises RenderLogError, FrameError for a scene that is gone, and SessionFileError for one that is another now.
    """
    if (out / RENDER_LOG).exists() and (out / RENDER_LOG).samefile(before / RENDER_LOG):
        raise RenderLogError(f"{out} holds the frames that are to be rendered again: name another folder")
    render_log = RenderLog(before / RENDER_LOG)
    begun = render_log.begun
    work.frames = sum(isinstance(record, FrameRecord) for record in render_log)
    work.stage = "compiling"
    scene = open_scene(
        _path("scene", begun.view.scene, session, before), mean_luminance_cd_m2=begun.view.mean_luminance_cd_m2
    )
    here = _here(begun.perception, session, before)
    rendering = Rendering(scene, view_of(begun.view), begun.eyes, here, begun.costs, begun.state)
    differences = Differences(before, begun)
    frames = None if begun.live else work.frames
    with Results(out, begun, save, frames=frames) as results:
        for record in render_log:
            if stop():
                break
            match record:
                case Perceive(perception):
                    rendering.perception = _here(perception, session, before)
                    results.perceive(perception)
                case Resumed():
                    rendering.perception = _here(record.perception, session, before)
                    rendering.costs, rendering.memory = record.costs, record.state
                    results.resume(record)
                case FrameRecord():
                    rendered = rendering.render(
                        record.frame, record.t_s, record.dt_s, record.head, record.state, record.saccade_impulses
                    )
                    rendering.correct(record.timings)
                    results.add(rendered, record)
                    results.note(rendered)
                    differences.add(rendered, rendering.perception.display, same=results.digest == record.sha256)
                    work.stage, work.frame = "rendering", work.frame + 1
    write_summary(results.summary(None, None), out)
    if begun.live:
        finish(out)
    return differences


def _path(what: str, named: str, session: SessionFile | None, folder: Path) -> str:
    """Where an input lies: its copy if there is one."""
    path = None if session is None else session.path_of(what, folder)
    return named if path is None else str(path)


def _here(perception: Settings, session: SessionFile | None, folder: Path) -> Settings:
    """Settings whose files are the session's copies."""
    named = files_of(perception).items()
    return changed(perception, {path: _path(what, file, session, folder) for what, (path, file) in named})
