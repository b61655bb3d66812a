"""Frames one after another, each with what is remembered of the ones before; and what a bridge's states are to them."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable

from entoptic.pipeline import EyePose, Frame, Perceived, RenderState, View, perceive
from entoptic.pipeline.budget import SCENE, SHIPPED, CostModel, Timing, corrected
from entoptic.pipeline.optics.ocular_dynamics import SaccadeImpulse
from entoptic.pipeline.scenes import Head, Scene
from entoptic.pipeline.warm_up import warm_up
from entoptic.services.settings import Settings
from entoptic.tracker_bridge.wire import NS_PER_S, Direction, Eye, EyeState, SaccadeOffset

FRESH_NS = 100_000_000
"""An eye's own direction of gaze older than this gives way to that of both eyes."""
IMPULSE_LASTS_NS = 2_000_000_000
"""A saccade that was over before moves the vitreous no more: a hundredth of its lag is left."""
FARTHEST_DEG = 90.0
"""No eye turns farther in its socket: a longer saccade is a glitch of the tracker, and moves nothing."""


@dataclasses.dataclass(frozen=True)
class Rendered:
    """One frame and all that made it."""

    frame_number: int
    t_s: float
    state: EyeState | None
    poses: tuple[EyePose, ...]
    frame: Frame
    perceived: Perceived
    scene_ms: float
    """What making the frame took."""
    reuses_frame: bool = False
    """Whether it was on show already."""

    @property
    def total_ms(self) -> float:
        """The frame's work: making it and perceiving it."""
        return self.scene_ms + sum(self.perceived.milliseconds.values())

    @property
    def timings(self) -> list[Timing]:
        """What took how long, for a cost model."""
        made = Timing(SCENE, "whole", self.perceived.image.size / 3e6, self.scene_ms)
        return self.perceived.timings + ([] if self.reuses_frame else [made])


class Rendering:
    """One person viewing a scene. The same calls give the same frames to the bit."""

    def __init__(
        self,
        scene: Scene,
        view: View,
        eyes: tuple[Eye, ...],
        perception: Settings,
        costs: CostModel = SHIPPED,
        memory: RenderState | None = None,
    ) -> None:
        self._scene, self._view, self._eyes = scene, view, eyes
        self.perception = perception
        self.costs = costs
        self.memory = memory
        """What the eyes remember after the last frame."""
        self._last: Frame | None = None

    def render(
        self,
        frame_number: int,
        t_s: float,
        dt_s: float,
        head: Head,
        state: EyeState | None,
        impulses: tuple[SaccadeImpulse, ...],
    ) -> Rendered:
        """One more frame. Where it fails, nothing is remembered of it."""
        begun = time.perf_counter()
        frame = self._scene.frame(t_s, self._view, head, self._eyes)
        frame.rgb_cd_m2.block_until_ready()
        scene_ms = (time.perf_counter() - begun) * 1e3
        poses = tuple(pose_of(state, eye, impulses) for eye in self._eyes)
        perceived = _perceive(frame, poses, self.perception, self.memory, dt_s, self.costs)
        reuses_frame, self._last = frame is self._last, frame
        self.memory = perceived.state
        return Rendered(frame_number, t_s, state, poses, frame, perceived, scene_ms, reuses_frame)

    def correct(self, timings: Iterable[Timing]) -> None:
        """Lets the costs follow what a frame took."""
        self.costs = corrected(self.costs, timings)

    @property
    def kept_memory(self) -> RenderState | None:
        """What the eyes remember, less the last frame with its glare: a cache, without which the same comes."""
        return None if self.memory is None else dataclasses.replace(self.memory, reusable={})

    def warm_up(self, stopped: Callable[[], bool]) -> float:
        """Compiles the scene and every effect before the clock runs; returns the seconds it took."""
        begun = time.perf_counter()
        asked = self.perception
        self._scene.frame(0.0, self._view, Head(), self._eyes).rgb_cd_m2.block_until_ready()
        warm_up(self._view, len(self._eyes), asked.observer, asked.display, asked, asked.plan, stopped)
        return time.perf_counter() - begun


def pose_of(state: EyeState | None, eye: Eye, impulses: tuple[SaccadeImpulse, ...] = ()) -> EyePose:
    """How one eye looks, by the bridge's word: its own gaze while that is fresh, its last trusted pupil, its lids.

    Both eyes make their saccades together: `impulses` are the same for both. Lids of which nothing is known are open.
    """
    if state is None:
        return EyePose()
    one = state.of(eye)
    gaze = one.gaze
    if gaze is None or state.t_ns - gaze.t_ns > FRESH_NS:
        gaze = state.gaze or gaze or Direction(0.0, 0.0, state.t_ns)
    openness = 1.0 if one.openness is None else one.openness
    return EyePose(gaze.azimuth_deg, gaze.elevation_deg, one.pupil_diameter_mm, openness, impulses)


def frames_known(seconds: float | None, end_ns: int | None, start_ns: int, fps: float) -> int | None:
    """How many frames are asked for or there are, whichever is less; None if neither is known."""
    lasts_s = [lasts for lasts in (seconds, None if end_ns is None else (end_ns - start_ns) / NS_PER_S) if lasts]
    return max(round(min(lasts_s) * fps), 1) if lasts_s else None


def gaze_deg(state: EyeState | None) -> tuple[float, float] | None:
    """Where both eyes look, for a head that follows them."""
    return None if state is None or state.gaze is None else (state.gaze.azimuth_deg, state.gaze.elevation_deg)


def impulses_of(saccades: Iterable[SaccadeOffset], t_ns: int) -> tuple[SaccadeImpulse, ...]:
    """How the eyes turned, for a frame at `t_ns` of the bridge's clock."""
    return tuple(
        SaccadeImpulse(saccade.azimuth_deg, saccade.elevation_deg, max(t_ns - saccade.offset_ns, 0) / NS_PER_S)
        for saccade in saccades
        if t_ns - saccade.offset_ns <= IMPULSE_LASTS_NS
        and max(abs(saccade.azimuth_deg), abs(saccade.elevation_deg)) <= FARTHEST_DEG
    )


def _perceive(
    frame: Frame,
    poses: tuple[EyePose, ...],
    perception: Settings,
    memory: RenderState | None,
    dt_s: float,
    costs: CostModel = SHIPPED,
) -> Perceived:
    return perceive(
        frame,
        poses,
        observer=perception.observer,
        display=perception.display,
        state=memory,
        dt_s=dt_s,
        effects=perception,
        planning=perception.plan,
        costs=costs,
    )
