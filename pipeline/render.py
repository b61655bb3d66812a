"""Measures a frame, plans, and runs the plan in LUI's order: what one person's eyes make of one frame."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt8

from pipeline.effects import acuity, adaptation, night_colour, tone
from pipeline.effects.glare import Glare, Sight, bounds, mixture, scatter
from pipeline.frame import Display, Frame, FrameError, View
from pipeline.measure import Measurement, luminance, measure
from pipeline.observer import Observer
from pipeline.optics import living
from pipeline.optics.living import Kick, LivingState
from pipeline.optics.pupil import watson_yellott_mm
from pipeline.plan import Effect, Plan, make_plan

DISPLAY_KEY = 0.18
"""Middle grey of ordinary auto-exposure (Reinhard 2002)."""


@dataclasses.dataclass(frozen=True)
class Looking:
    """How one eye looks at a frame."""

    azimuth_deg: float = 0.0
    """Direction of gaze from the middle of the view, to the right positive."""
    elevation_deg: float = 0.0
    """Upwards positive."""
    pupil_mm: float | None = None
    """Measured diameter; None for what Watson & Yellott expect of this light and age."""
    openness: float = 1.0
    """How far the lids are open, 0 to 1. It shapes glare where `living.lids` is on."""
    kicks: tuple[Kick, ...] = ()
    """The turns of the eye since the frame before, saccades and microsaccades."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.azimuth_deg) and math.isfinite(self.elevation_deg)):
            raise FrameError(f"gaze ({self.azimuth_deg}, {self.elevation_deg})°: both angles must be finite numbers")
        if self.pupil_mm is not None and not 0.5 <= self.pupil_mm <= 12:
            raise FrameError(f"a pupil of {self.pupil_mm} mm: give 0.5 to 12 mm, or none to have it computed")
        if not 0 <= self.openness <= 1:
            raise FrameError(f"an openness of {self.openness}: it must lie between 0, closed, and 1, open")


@dataclasses.dataclass(frozen=True)
class RenderState:
    """What the eyes remember from one frame to the next."""

    adapted_cd_m2: tuple[float, ...]
    """The luminance each eye is adapted to."""
    living: tuple[LivingState, ...] = ()
    """What of each eye is in motion; empty: all at rest."""
    glared: Glared | None = None
    """The last frame with its glare: while nothing changes it serves again."""


@dataclasses.dataclass(frozen=True, eq=False)
class Glared:
    """A frame with glare, and what it was made of."""

    rgb_cd_m2: Float[Array, "eye 3 y x"]
    cause: tuple[object, ...]
    """Of each eye's glare (Sight.cause)."""
    result: Float[Array, "eye 3 y x"]


@dataclasses.dataclass(frozen=True)
class Perceived:
    """What became of a frame."""

    image: UInt8[np.ndarray, "eye y x 3"]
    """Code values for the display, sRGB."""
    linear: Float[Array, "eye 3 y x"]
    """The same before encoding: linear Rec.709, 1 = the display's peak."""
    plan: Plan
    state: RenderState
    """Pass it on with the next frame."""
    measured: tuple[Measurement, ...]
    pupil_mm: tuple[float, ...]
    """The diameters that were used."""
    milliseconds: dict[str, float]
    """Time of `measure`, the glare's `kernel`, each effect that ran, and `encode`, each waited for to its end."""


def perceive(
    frame: Frame,
    eye: Looking | Sequence[Looking] = Looking(),
    *,
    observer: Observer = Observer(),
    display: Display = Display(),
    state: RenderState | None = None,
    dt_s: float = 0.0,
    glare: Glare = Glare(),
) -> Perceived:
    """A frame as a person perceives it.

    `eye` is one `Looking` for all images of the frame or one for each. `state` is what the frame before left behind,
    `dt_s` ≥ 0 how long ago that was; without a state the eyes are fully adapted to this frame and at rest.
    Raises FrameError where the number of eyes and of images differ.
    """
    images = frame.rgb_cd_m2.shape[0]
    eyes = (eye,) * images if isinstance(eye, Looking) else tuple(eye)
    if len(eyes) != images or (state is not None and len(state.adapted_cd_m2) != images):
        raise FrameError(f"a frame of {images} images for {len(eyes)} eyes: give one for each")
    clock = _Clock()
    measured = clock.time("measure", lambda: measure(frame))
    adapted = clock.time(Effect.ADAPTATION, lambda: _adapt(measured, eyes, state, dt_s))
    moving = _move(observer, eyes, pupils := _pupils(frame.view, eyes, adapted, observer), state, dt_s)
    poses = [
        living.pose_of(motion, observer, pupil_mm, eye.openness, measured=eye.pupil_mm is not None)
        for motion, pupil_mm, eye in zip(moving, pupils, eyes, strict=True)
    ]
    kernels = clock.time(
        "kernel",
        lambda: tuple(
            mixture(glare.model, observer, pose, luminance_cd_m2, frame.view.ppd_centre)
            for pose, luminance_cd_m2 in zip(poses, adapted, strict=True)
        ),
    )
    plan = make_plan(measured, adapted, [bounds(kernel) for kernel in kernels], glare, frame.lights)
    runs = {step.effect for step in plan if step.runs}
    exposures = np.array([adaptation.exposure(luminance_cd_m2) for luminance_cd_m2 in adapted])
    rgb, glared = frame.rgb_cd_m2, None
    if Effect.GLARE in runs:
        sights = [
            Sight(
                view=frame.view,
                measured=measured[k],
                gaze_px=frame.view.pixel_of(eye.azimuth_deg, eye.elevation_deg),
                kernel=kernels[k],
                observer=observer,
                pose=poses[k],
                adapted_cd_m2=adapted[k],
                ceiling_cd_m2=tone.ceiling_cd_m2(exposures[k], display.peak_cd_m2) if glare.above_display else None,
                lights=frame.lights,
            )
            for k, eye in enumerate(eyes)
        ]
        before = None if state is None else state.glared
        glared = clock.time(Effect.GLARE, lambda: _glare(frame, sights, glare, before))
        rgb = glared.result
    if Effect.ACUITY in runs:
        rgb = clock.time(Effect.ACUITY, lambda: acuity.dark_acuity(rgb))
    shown = clock.time(Effect.TONE, lambda: tone.aces(rgb, exposures, display.peak_cd_m2))
    if Effect.NIGHT_COLOUR in runs:
        rods = np.array([adaptation.rod_sensitivity(luminance_cd_m2) for luminance_cd_m2 in adapted])
        shown = clock.time(Effect.NIGHT_COLOUR, lambda: night_colour.night_tint(shown, rods))
    image = clock.time("encode", lambda: np.asarray(tone.encode(shown, tone.black_share(display))))
    used_mm = tuple(pose.pupil_mm for pose in poses)
    return Perceived(image, shown, plan, RenderState(adapted, moving, glared), measured, used_mm, clock.milliseconds)


def as_displayed(frame: Frame, display: Display = Display()) -> UInt8[np.ndarray, "eye y x 3"]:
    """A frame as a renderer without an eye shows it: exposed for middle grey, tone-mapped, encoded."""
    mean_log = np.asarray(_mean_log(frame.rgb_cd_m2))
    shown = tone.aces(frame.rgb_cd_m2, DISPLAY_KEY / np.exp(mean_log), display.peak_cd_m2)
    return np.asarray(tone.encode(shown, tone.black_share(display)))


@jax.jit
def _mean_log(rgb: Float[Array, "eye 3 y x"]) -> Float[Array, "eye"]:
    return jnp.log(luminance(rgb) + np.float32(adaptation.FLOOR_CD_M2)).mean((1, 2))


def _adapt(
    measured: Sequence[Measurement], eyes: Sequence[Looking], state: RenderState | None, dt_s: float
) -> tuple[float, ...]:
    targets = [
        adaptation.target_cd_m2(image, eye.azimuth_deg, eye.elevation_deg)
        for image, eye in zip(measured, eyes, strict=True)
    ]
    if state is None:
        return tuple(targets)
    return tuple(
        adaptation.adapt_cd_m2(before, target, dt_s)
        for before, target in zip(state.adapted_cd_m2, targets, strict=True)
    )


def _pupils(view: View, eyes: Sequence[Looking], adapted: Sequence[float], observer: Observer) -> tuple[float, ...]:
    field_deg2 = view.fov_deg * math.degrees(2 * math.atan(view.height_px / 2 / view.focal_px))
    return tuple(
        watson_yellott_mm(luminance_cd_m2, field_deg2, observer.age_years) if eye.pupil_mm is None else eye.pupil_mm
        for eye, luminance_cd_m2 in zip(eyes, adapted, strict=True)
    )


def _move(
    observer: Observer, eyes: Sequence[Looking], pupils: Sequence[float], state: RenderState | None, dt_s: float
) -> tuple[LivingState, ...]:
    before = () if state is None else state.living
    return tuple(
        living.step(motion, observer, dt_s, pupil_mm, eye.kicks)
        for motion, pupil_mm, eye in zip(before or (living.at_rest(observer),) * len(eyes), pupils, eyes, strict=True)
    )


def _glare(frame: Frame, sights: Sequence[Sight], settings: Glare, before: Glared | None) -> Glared:
    """The frame with its glare: the one before, where nothing changed."""
    cause = (settings, *(what for sight in sights for what in sight.cause(settings)))
    if before is not None and before.rgb_cd_m2 is frame.rgb_cd_m2 and before.cause == cause:
        return before
    images = [scatter(frame.rgb_cd_m2[k], sight, settings) for k, sight in enumerate(sights)]
    # Waited for here: the clock does not see into a record.
    return Glared(frame.rgb_cd_m2, cause, jax.block_until_ready(jnp.stack(images)))


Result = TypeVar("Result")


class _Clock:
    """Times each part to its end, not to its dispatch."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}

    def time(self, part: str, run: Callable[[], Result]) -> Result:
        begun = time.perf_counter()
        result = jax.block_until_ready(run())
        self.milliseconds[part] = (time.perf_counter() - begun) * 1e3
        return result
