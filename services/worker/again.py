"""Renders what a folder's moments say once more, without any bridge: the same frames to the bit."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import structlog
from msgspec.structs import replace

from entoptic.pipeline.scenes import open_scene
from entoptic.services.options import Save
from entoptic.services.process import Stop
from entoptic.services.results import session_file
from entoptic.services.results.finish import finish, write_summary
from entoptic.services.results.frames import Results
from entoptic.services.results.moments import FILE, Moment, Moments, MomentsError, Perceive, Resumed
from entoptic.services.results.session_file import SessionFile
from entoptic.services.results.tally import WorkerSummary
from entoptic.services.settings import Settings
from entoptic.services.worker.rendering import Rendering


@dataclasses.dataclass(frozen=True)
class Again:
    """What became of it."""

    summary: WorkerSummary
    first_different: int | None
    """Number of the first frame that is not what it was; None where all are."""
    note: str | None
    """What was left out."""


def run(
    folder: Path, out: Path, save: frozenset[Save], stop: Stop, log: structlog.typing.FilteringBoundLogger
) -> Again:
    """Renders all frames of a folder into another one.

    Raises MomentsError, FrameError for a scene that is gone, and SessionFileError for one that is another now.
    """
    moments = Moments(folder / FILE)
    if (out / FILE).exists() and (out / FILE).samefile(folder / FILE):
        raise MomentsError(f"{out} holds the frames that are to be rendered again: name another folder")
    begun, session = moments.begun, _session(folder)
    frames = sum(isinstance(record, Moment) for record in moments)
    log.info("preparing", scene=begun.scene)
    scene = open_scene(_path("scene", begun.scene, session, folder), mean_luminance_cd_m2=begun.mean_luminance_cd_m2)
    rendering = Rendering(
        scene, begun.view, begun.eyes, _here(begun.perception, session, folder), begun.costs, begun.state
    )
    first_different, done = None, 0
    with Results(out, begun, save, parts=begun.live, frames=None if begun.live else frames) as results:
        for record in moments:
            if stop():
                break
            match record:
                case Perceive(perception):
                    rendering.perception = _here(perception, session, folder)
                    results.perceive(perception)
                case Resumed():
                    rendering.perception = _here(record.perception, session, folder)
                    rendering.costs, rendering.memory = record.costs, record.state
                    results.resume(record)
                case Moment():
                    rendered = rendering.render(
                        record.frame, record.t_s, record.dt_s, record.head, record.state, record.saccade_impulses
                    )
                    rendering.correct(record.timings)
                    results.add(rendered, record)
                    results.note(rendered)
                    if first_different is None and results.digest != record.sha256:
                        first_different = record.frame
                    done += 1
                    log.info("progress", frame=done, frames=frames, dropped=record.dropped)
    summary = results.summary(None, None)
    write_summary(summary, out)
    if begun.live:
        finish(out)
    return Again(summary, first_different, moments.note)


def _session(folder: Path) -> SessionFile | None:
    return session_file.read(folder) if (folder / session_file.FILE).exists() else None


def _path(what: str, named: str, session: SessionFile | None, folder: Path) -> str:
    """Where an input lies: its copy if there is one."""
    path = None if session is None else session.path_of(what, folder)
    return named if path is None else str(path)


def _here(perception: Settings, session: SessionFile | None, folder: Path) -> Settings:
    """Settings whose files are the session's copies."""
    if not perception.tone.curve:
        return perception
    curve = _path("tone curve", perception.tone.curve, session, folder)
    return replace(perception, tone=replace(perception.tone, curve=curve))
