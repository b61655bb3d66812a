"""A whole session of recorded eyes: every frame rendered at its own recorded time, however long it recording.

Theory of operation: one loop over the frames. For each the source is read through the chain until the newest state of
the frame's time is known, and all that is read goes into the tables. All results are written into a folder beside the
final one, which takes its name only when they are whole.
"""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path

import msgspec
from rich.console import Console
from rich.markup import escape

from entoptic.atomic_file import write_json
from entoptic.pipeline.budget import SHIPPED
from entoptic.pipeline.scenes import Head
from entoptic.pipeline.scenes.head_path import open_head_path
from entoptic.services import recording, simulated_light
from entoptic.services import settings as settings_file
from entoptic.services.bridge.tables import Tables
from entoptic.services.eye_data import SIMULATED_SECONDS, open_eyes
from entoptic.services.process import Stop
from entoptic.services.rendering import Rendering, frames_known, gaze_deg, impulses_of
from entoptic.services.report import page as report
from entoptic.services.results import session_file
from entoptic.services.results.finish import finish, write_summary
from entoptic.services.results.folder import BRIDGE, results_folder
from entoptic.services.results.frames import Results
from entoptic.services.results.render_log import FrameRecord, begin
from entoptic.services.results.tally import Reception
from entoptic.services.session.eyes import RecordedEyes
from entoptic.services.session.watch import Work, watch
from entoptic.services.session_config import EYES, OpenedSession
from entoptic.tracker_bridge import pupil_map
from entoptic.tracker_bridge.chain import Chain
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.source import Source
from entoptic.tracker_bridge.sources import SIMULATED

LIGHT = "scene_luminance.csv"
NOTHING = "stopped before the first frame: nothing was written"


class EyesSummary(msgspec.Struct, frozen=True):
    """What was read of the eye data."""

    source: str
    states: int
    late_samples: int
    """Samples that came too late, twice, backwards or from the future, and were left out."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a session."""

    frames: int
    eyes: EyesSummary
    interrupted: bool


def keep(opened: OpenedSession, final: Path, stop: Stop, console: Console) -> Outcome:
    """Renders every frame of a recording into a folder with all that belongs to it.

    Raises StoppedError, ResultsFolderError, and what source and scene raise; then no folder is left.
    """
    with results_folder(final) as folder:
        settings_file.write(folder / "settings.toml", opened.config.settings)
        session = session_file.of_session(opened, "offline")
        session.write(folder)
        if (problem := recording.keep_inputs(folder, opened.config)) is not None:
            console.print(f"[yellow]![/yellow] {escape(str(problem))}", soft_wrap=True)
        outcome = watch(lambda work: _render(opened, folder, stop, work), stop, console, NOTHING)
        write_json(folder / BRIDGE, outcome.eyes)
        notes = recording.HostNotes(interrupted=outcome.interrupted)
        write_json(folder / recording.SUMMARY, recording.summary_of(session, notes, finish(folder)))
        report.write(folder)
    return outcome


def _render(opened: OpenedSession, folder: Path, stop: Stop, work: Work) -> Outcome:
    """The same session gives the same frames on every machine: costs stay as they are."""
    view, settings = opened.config.view, opened.config.settings
    rendering = Rendering(opened.scene, opened.view, EYES[view.eyes], settings, SHIPPED.beside_scene(opened.scene.cost))
    work.stage = "compiling"
    source = _viewing_eyes(opened, folder)
    warm_up_s = rendering.warm_up(stop)
    path, eyes_map = open_head_path(view.head), opened.config.eyes.pupil_map
    chain = Chain(
        latency_mode=opened.config.eyes.latency_mode,
        pupil_map=None if eyes_map is None else pupil_map.read(Path(eyes_map)),
    )
    head, t_s, impulses_matter = Head(), 0.0, settings.observer.ocular_dynamics.vitreous
    with contextlib.closing(Tables(folder)) as tables:
        eyes = RecordedEyes(source, chain, view.seconds, stop, tables.add)
        work.frames = frames_known(view.seconds, eyes.end_ns, eyes.start_ns, view.fps)
        work.stage, work.keeps = "rendering", not stop()
        state = None
        with Results(folder, begin(view, rendering, live=False), frozenset(view.save), frames=work.frames) as results:
            while not stop() and (work.frames is None or work.frame < work.frames):
                before_s, t_s = t_s, work.frame / view.fps
                t_ns = eyes.start_ns + round(t_s * NS_PER_S)
                saccades = eyes.saccades_until(t_ns) if impulses_matter else ()
                state = eyes.until(t_ns) or state
                if work.frames is None and eyes.ended_ns is not None and t_ns > eyes.ended_ns:
                    break
                dt_s, impulses = t_s - before_s, impulses_of(saccades, t_ns)
                head = path.step(t_s, dt_s, head, gaze_deg(state))
                rendered = rendering.render(work.frame, t_s, dt_s, head, state, impulses)
                results.add(rendered, FrameRecord(work.frame, t_s, dt_s, head, state, impulses, 0))
                results.note(rendered)
                work.frame += 1
        eyes.finish()
    summary = results.summary(Reception(eyes.states, 0, 0, 0, {}), warm_up_s)
    write_summary(summary, folder)
    return Outcome(work.frame, EyesSummary(source.info.name, eyes.states, chain.late_count), stop())


def _viewing_eyes(opened: OpenedSession, folder: Path) -> Source:
    """The eye data; simulated pupils answer to the light of the scene, which is kept as a table."""
    eyes, view = opened.config.eyes, opened.config.view
    if eyes.source != SIMULATED:
        return opened.source
    steps = simulated_light.of_scene(opened.scene, opened.view, view.head, view.seconds or SIMULATED_SECONDS)
    simulated_light.write(folder / LIGHT, steps)
    return open_eyes(eyes, view.seconds, str(folder / LIGHT))
