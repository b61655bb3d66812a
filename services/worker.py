"""The pipeline process: renders what the bridge publishes."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import structlog
from msgspec.structs import replace

from pipeline import Frame, GlareLevel, Looking, Perceived, Planning, RenderState, View, perceive
from pipeline.budget import SHIPPED, Choice, CostModel, corrected
from pipeline.optics.living import Kick
from pipeline.plan import SKIPPED
from pipeline.scenes import Head, Scene
from pipeline.scenes.head_path import HeadPath
from services.options import Save
from services.process import Stop
from services.reader import StateReader
from services.results import Heard, Rendered, Results, WorkerSummary
from services.settings import Settings
from tracker_bridge.wire import NS_PER_S, Direction, Eye, EyeState, SaccadeOffset

FRESH_NS = 100_000_000
"""An eye's own direction of gaze older than this gives way to that of both eyes."""
GONE_S = 3.0
"""After so long without a state or a heartbeat a bridge says nothing about the eyes any more. Engineering choice: three
heartbeats."""
KICK_LASTS_NS = 2_000_000_000
"""A saccade that was over before moves the vitreous no more: a hundredth of its lag is left."""
FARTHEST_DEG = 90.0
"""No eye turns farther in its socket: a longer saccade is a glitch of the tracker, and kicks nothing."""


@dataclasses.dataclass(frozen=True)
class WorkerSettings:
    """How a stream is rendered."""

    view: View
    fps: float
    eyes: tuple[Eye, ...]
    """Left to right, as they stand side by side in the output."""
    live: bool
    seconds: float | None
    out: Path
    save: frozenset[Save]


@dataclasses.dataclass(frozen=True)
class _Moment:
    """When a frame is rendered, and with what."""

    frame: int
    t_s: float
    state: EyeState | None
    dropped: int
    """Frames left out so far."""
    kicks: tuple[Kick, ...] = ()
    """The eyes' turns that were told since the frame before."""


def run(
    reader: StateReader,
    scene: Scene,
    head_path: HeadPath,
    settings: WorkerSettings,
    perception: Settings,
    stop: Stop,
    log: structlog.typing.FilteringBoundLogger,
    costs: CostModel = SHIPPED,
) -> WorkerSummary:
    """Renders the stream to its end, `seconds` of it, or until asked to stop; its results lie in `out`.

    `costs` matter where frames have a budget. Live, they are corrected by what each frame takes; else the same session
    gives the same frames on every machine, so they are the shipped ones.
    """
    log.info("preparing", scene=scene.name)
    warm_up_s = _warm_up(scene, settings, perception)
    log.info("prepared", seconds=round(warm_up_s, 2))
    started = reader.wait_for_start(stop)
    start_ns = 0 if started is None else started.t_ns
    lasts_s = [settings.seconds]
    if started is not None and started.t_end_ns is not None:
        lasts_s.append((started.t_end_ns - start_ns) / NS_PER_S)
    known_s = min((lasts for lasts in lasts_s if lasts is not None), default=None)
    frames = None if known_s is None else max(round(known_s * settings.fps), 1)
    moments = _live_moments if settings.live else _recorded_moments
    memory: RenderState | None = None
    head, last_t_s = Head(), 0.0
    with Results(
        settings.out, settings.view, settings.fps, settings.eyes, settings.save, frames, perception.display
    ) as results:
        kicked = perception.observer.living.vitreous
        for moment in moments(reader, settings.fps, start_ns, frames, stop, kicked):
            dt_s, last_t_s = moment.t_s - last_t_s, moment.t_s
            gaze = None if moment.state is None else moment.state.gaze
            direction = None if gaze is None else (gaze.azimuth_deg, gaze.elevation_deg)
            head = head_path.step(moment.t_s, dt_s, head, direction)
            begun = time.perf_counter()
            frame = scene.frame(moment.t_s, settings.view, head, settings.eyes)
            frame.rgb_cd_m2.block_until_ready()
            scene_ms = (time.perf_counter() - begun) * 1e3
            looking = tuple(looking_of(moment.state, eye, moment.kicks) for eye in settings.eyes)
            perceived = _perceive(frame, looking, perception, memory, dt_s, costs)
            memory = perceived.state
            if settings.live:
                costs = corrected(costs, perceived.timings)
            results.add(Rendered(moment.frame, moment.t_s, moment.state, looking, frame, perceived, scene_ms))
            results.dropped = moment.dropped
            log.info("progress", frame=moment.frame + 1, frames=frames, dropped=moment.dropped)
        if frames is not None and not settings.live:
            # States between the last frame and the end, so that the count of what was received is of all.
            reader.until(start_ns + round(frames / settings.fps * NS_PER_S), stop)
    heard = Heard(reader.received, reader.skipped, reader.events.gaps, reader.events.lost, reader.refused)
    return results.summary(heard, warm_up_s)


def looking_of(state: EyeState | None, eye: Eye, kicks: tuple[Kick, ...] = ()) -> Looking:
    """How one eye looks, by the bridge's word: its own gaze while that is fresh, its last trusted pupil, its lids.

    Both eyes make their saccades together, so `kicks` are the same for both. Lids of which nothing is known are open.
    """
    if state is None:
        return Looking()
    one = state.of(eye)
    gaze = one.gaze
    if gaze is None or state.t_ns - gaze.t_ns > FRESH_NS:
        gaze = state.gaze or gaze or Direction(0.0, 0.0, state.t_ns)
    openness = 1.0 if one.openness is None else one.openness
    return Looking(gaze.azimuth_deg, gaze.elevation_deg, one.diameter_mm, openness, kicks)


def kicks_of(saccades: Iterable[SaccadeOffset], t_ns: int) -> tuple[Kick, ...]:
    """How the eyes turned, for a frame at `t_ns` of the bridge's clock."""
    return tuple(
        Kick(saccade.azimuth_deg, saccade.elevation_deg, max(t_ns - saccade.offset_ns, 0) / NS_PER_S)
        for saccade in saccades
        if t_ns - saccade.offset_ns <= KICK_LASTS_NS
        and max(abs(saccade.azimuth_deg), abs(saccade.elevation_deg)) <= FARTHEST_DEG
    )


def _perceive(
    frame: Frame,
    looking: tuple[Looking, ...],
    perception: Settings,
    memory: RenderState | None,
    dt_s: float,
    costs: CostModel = SHIPPED,
) -> Perceived:
    return perceive(
        frame,
        looking,
        observer=perception.observer,
        display=perception.display,
        state=memory,
        dt_s=dt_s,
        effects=perception,
        planning=perception.plan,
        costs=costs,
    )


def _warm_up(scene: Scene, settings: WorkerSettings, perception: Settings) -> float:
    """Compiles the scene and every effect before the clock runs; returns the seconds it took.

    A lamp too bright for float32 compiles another way of glare, a pupil between two computed ones makes a kernel of
    two, a budget may choose other levels, and dark tiles alone and fades are compiled apart.
    """
    begun = time.perf_counter()
    scene.frame(0.0, settings.view, Head(), settings.eyes).rgb_cd_m2.block_until_ready()
    lamp = np.zeros((len(settings.eyes), 3, settings.view.height_px, settings.view.width_px), np.float32)
    full = replace(perception, plan=Planning(everything=True, leave_out=perception.plan.leave_out))
    short = () if perception.plan.budget_ms is None else (GlareLevel.VEIL,)
    lesser = [(5e3, replace(full, glare=replace(full.glare, level=level))) for level in short]
    for lamp_cd_m2, asked in ((5e3, full), (1e6, full), *lesser):
        lamp[:, :, settings.view.height_px // 2, settings.view.width_px // 2] = lamp_cd_m2
        frame = Frame.from_rgb(lamp, settings.view.fov_deg)
        _perceive(frame, (Looking(pupil_mm=4.1),) * len(settings.eyes), asked, None, 0.0)
    lamp[:] = 100.0
    lamp[:, :, : settings.view.height_px // 8, : settings.view.width_px // 8] = 1e-3
    bright = Frame.from_rgb(lamp, settings.view.fov_deg)
    fading = {"acuity": Choice(perception.acuity.method.value, SKIPPED, 0.5)}
    before = RenderState((1.0,) * len(settings.eyes), choices=fading)
    _perceive(bright, (Looking(pupil_mm=4.0),) * len(settings.eyes), perception, before, 0.0)
    return time.perf_counter() - begun


def _recorded_moments(
    reader: StateReader, fps: float, start_ns: int, frames: int | None, stop: Stop, kicked: bool
) -> Iterator[_Moment]:
    """Every frame of the recording, each with the newest state at its own recorded time, and the saccades till then."""
    state, frame = None, 0
    while not stop() and (frames is None or frame < frames):
        t_s = frame / fps
        t_ns = start_ns + round(t_s * NS_PER_S)
        saccades = reader.saccades_until(t_ns, stop) if kicked else ()
        state = reader.until(t_ns, stop) or state
        if stop() or (frames is None and reader.ended is not None and start_ns + t_s * NS_PER_S > reader.ended.t_ns):
            return
        yield _Moment(frame, t_s, state, 0, kicks_of(saccades, t_ns))
        frame += 1


def _live_moments(
    reader: StateReader, fps: float, start_ns: int, frames: int | None, stop: Stop, kicked: bool
) -> Iterator[_Moment]:
    """Frames by the clock, each with the newest state and saccades; those whose time has passed are dropped."""
    state, frame, dropped = None, 0, 0
    begun = time.monotonic()
    while not stop() and (frames is None or frame < frames) and reader.ended is None:
        wait_s = begun + frame / fps - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        state = reader.newest() or (None if reader.silent_s > GONE_S else state)
        heard = reader.saccades_heard()
        kicks = kicks_of(heard, state.t_ns) if kicked and state is not None else ()
        yield _Moment(frame, frame / fps, state, dropped, kicks)
        due = max(int((time.monotonic() - begun) * fps), frame + 1)
        dropped, frame = dropped + due - frame - 1, due
