"""The pipeline process where every frame of a recording is rendered, each at its own recorded time."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Iterator
from pathlib import Path

import msgspec
import structlog

from entoptic.pipeline.optics.ocular_dynamics import SaccadeImpulse
from entoptic.pipeline.scenes import Head
from entoptic.pipeline.scenes.head_path import HeadPath
from entoptic.services.options import Save
from entoptic.services.process import Stop
from entoptic.services.reader import StateReader
from entoptic.services.results.finish import write_summary
from entoptic.services.results.frames import Results
from entoptic.services.results.moments import Begun, Moment
from entoptic.services.results.tally import Heard, WorkerSummary
from entoptic.services.worker.checkpoint import Job
from entoptic.services.worker.rendering import Rendering, gaze_deg, kicks_of
from entoptic.tracker_bridge.wire import NS_PER_S, EyeState


def run(
    reader: StateReader,
    rendering: Rendering,
    head_path: HeadPath,
    job: Job,
    out: Path,
    save: frozenset[Save],
    seconds: float | None,
    stop: Stop,
    log: structlog.typing.FilteringBoundLogger,
) -> WorkerSummary:
    """Renders the stream to its end, `seconds` of it, or until asked to stop; its results lie in `out`.

    The same session gives the same frames on every machine: costs stay as they are.
    """
    log.info("preparing", scene=job.scene)
    warm_up_s = rendering.warm_up(stop)
    log.info("prepared", seconds=round(warm_up_s, 2))
    started = reader.wait_for_start(stop)
    start_ns = 0 if started is None else started.t_ns
    frames = frames_known(seconds, None if started is None else started.t_end_ns, start_ns, job.fps)
    head, last_t_s = Head(), 0.0
    begun = begin(job, rendering, live=False)
    with Results(out, begun, save, parts=False, frames=frames) as results:
        kicked = rendering.perception.observer.ocular_dynamics.vitreous
        for frame, t_s, state, saccade_impulses in _frames(reader, job.fps, start_ns, frames, stop, kicked):
            dt_s, last_t_s = t_s - last_t_s, t_s
            head = head_path.step(t_s, dt_s, head, gaze_deg(state))
            rendered = rendering.render(frame, t_s, dt_s, head, state, saccade_impulses)
            results.add(rendered, Moment(frame, t_s, dt_s, head, state, saccade_impulses, 0))
            results.note(rendered)
            log.info("progress", frame=frame + 1, frames=frames, dropped=0)
        if frames is not None:
            # States between the last frame and the end, so that the count of what was received is of all.
            reader.until(start_ns + round(frames / job.fps * NS_PER_S), stop)
    summary = results.summary(heard(reader), warm_up_s)
    write_summary(summary, out)
    return summary


def begin(job: Job, rendering: Rendering, *, live: bool, zero_s: float = 0.0) -> Begun:
    """What a file of moments begins with."""
    return Begun(
        program=importlib.metadata.version("entoptic"),
        live=live,
        zero_s=zero_s,
        perception=rendering.perception,
        costs=rendering.costs,
        state=rendering.kept_memory,
        **msgspec.structs.asdict(job),
    )


def frames_known(seconds: float | None, end_ns: int | None, start_ns: int, fps: float) -> int | None:
    """How many frames are asked for or there are, whichever is less; None if neither is known."""
    lasts_s = [lasts for lasts in (seconds, None if end_ns is None else (end_ns - start_ns) / NS_PER_S) if lasts]
    return max(round(min(lasts_s) * fps), 1) if lasts_s else None


def heard(reader: StateReader) -> Heard:
    """How well the bridge was heard so far."""
    return Heard(reader.received, reader.skipped, reader.events.gaps, reader.events.lost, reader.refused)


def _frames(
    reader: StateReader, fps: float, start_ns: int, frames: int | None, stop: Stop, kicked: bool
) -> Iterator[tuple[int, float, EyeState | None, tuple[SaccadeImpulse, ...]]]:
    """Each frame's number and time, with the newest state at its own recorded time, and the saccades till then."""
    state, frame = None, 0
    while not stop() and (frames is None or frame < frames):
        t_s = frame / fps
        t_ns = start_ns + round(t_s * NS_PER_S)
        saccades = reader.saccades_until(t_ns, stop) if kicked else ()
        state = reader.until(t_ns, stop) or state
        if stop() or (frames is None and reader.ended is not None and start_ns + t_s * NS_PER_S > reader.ended.t_ns):
            return
        yield frame, t_s, state, kicks_of(saccades, t_ns)
        frame += 1
