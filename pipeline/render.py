"""Measures a frame, plans, and runs the plan in LUI's order: what one person's eyes make of one frame."""

from __future__ import annotations

import dataclasses
import functools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.budget import SHIPPED, Choice, CostModel, Timing
from entoptic.pipeline.display_light import seen_peak_cd_m2
from entoptic.pipeline.effects import acuity, adaptation, afterimage, night_colour, rod_noise, tone
from entoptic.pipeline.effects.adaptation import Adapted
from entoptic.pipeline.effects.adaptation.pigments import PUPIL_MM
from entoptic.pipeline.effects.afterimage import Retina
from entoptic.pipeline.effects.encode import encode
from entoptic.pipeline.effects.glare import Glare, GlareLevel, Mixture, Sight, mixture, scatter
from entoptic.pipeline.effects.settings import Effects
from entoptic.pipeline.eye_pose import EyePose
from entoptic.pipeline.frame import Display, Frame, FrameError, View
from entoptic.pipeline.measure import Measurement, luminance, measure
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import ocular_dynamics
from entoptic.pipeline.optics.ocular_dynamics import OcularState
from entoptic.pipeline.optics.pupil import watson_yellott_mm
from entoptic.pipeline.plan import SKIPPED, Effect, Eye, Plan, Planning, Scenery, Step, make_plan

DISPLAY_KEY = 0.18
"""Middle grey of ordinary auto-exposure (Reinhard 2002)."""


@dataclasses.dataclass(frozen=True)
class RenderState:
    """What the eyes, and planning, remember from one frame to the next."""

    adapted_cd_m2: tuple[float, ...]
    """The luminance each eye is adapted to."""
    ocular: tuple[OcularState, ...] = ()
    """What of each eye is in motion; empty: all at rest."""
    glared: Glared | None = None
    """The last frame with its glare: while nothing changes it serves again."""
    adapted: tuple[Adapted, ...] = ()
    """All that adaptation takes along; empty: each eye has looked at its luminance for long."""
    retinas: tuple[Retina, ...] = ()
    """What each eye has seen and where; empty: nothing yet."""
    choices: Mapping[str, Choice] = dataclasses.field(default_factory=dict)
    """Levels of the effects, and fades between them."""
    elapsed_s: float = 0.0
    """Since the first frame."""


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

    image: np.ndarray
    """(eye, y, x, 3): what the display is sent. uint8 code values of sRGB unless the display says otherwise."""
    linear: Float[Array, "eye 3 y x"]
    """The same before encoding: linear Rec.709, 1 = the display's peak."""
    plan: Plan
    state: RenderState
    """Pass it on with the next frame."""
    measured: tuple[Measurement, ...]
    pupil_mm: tuple[float, ...]
    """The diameters that were used."""
    kernels: tuple[Mixture, ...]
    """Each eye's for glare, whether it ran or not."""
    reused: bool
    """Whether nothing changed that glare depends on, so that it was not computed."""
    milliseconds: dict[str, float]
    """Time of `measure`, the glare's `kernel`, `plan`, each effect that ran, and `encode`, each to its end."""

    @property
    def timings(self) -> list[Timing]:
        """What took how long, for a cost model; without effects that are between two levels."""
        megapixels = self.image.size / 3e6
        parts = [Timing(part, "whole", megapixels, self.milliseconds[part]) for part in ("measure", "plan", "encode")]
        return parts + [
            Timing(step.effect, step.level, megapixels, self.milliseconds[step.effect])
            for step in self.plan
            if step.effect in self.milliseconds
            and step.fading_from is None
            and not (step.effect is Effect.GLARE and self.reused)
        ]


def perceive(
    frame: Frame,
    eye: EyePose | Sequence[EyePose] = EyePose(),
    *,
    observer: Observer = Observer(),
    display: Display = Display(),
    state: RenderState | None = None,
    dt_s: float = 0.0,
    effects: Effects = Effects(),
    planning: Planning = Planning(),
    costs: CostModel = SHIPPED,
) -> Perceived:
    """A frame as a person perceives it.

    `eye` is one `EyePose` for all images of the frame or one for each. `state` is what the frame before left behind,
    `dt_s` how long ago that was; without a state the eyes are fully adapted to this frame and at rest. `costs` matter
    where `planning` sets a budget. Raises FrameError where the number of eyes and of images differ.
    """
    images = frame.rgb_cd_m2.shape[0]
    eyes = (eye,) * images if isinstance(eye, EyePose) else tuple(eye)
    if len(eyes) != images or (state is not None and len(state.adapted_cd_m2) != images):
        raise FrameError(f"a frame of {images} images for {len(eyes)} eyes: give one for each")
    clock = _Clock()
    measured = clock.time("measure", lambda: measure(frame))
    adapted = clock.time(Effect.ADAPTATION, lambda: _adapt(frame, measured, eyes, state, dt_s, effects))
    adapted_cd_m2 = tuple(one.luminance_cd_m2 for one in adapted)
    moving = _move(observer, eyes, pupils := _pupils(frame.view, eyes, adapted_cd_m2, observer), state, dt_s)
    poses = [
        ocular_dynamics.pose_of(motion, observer, pupil_mm, eye.openness, measured=eye.pupil_mm is not None)
        for motion, pupil_mm, eye in zip(moving, pupils, eyes, strict=True)
    ]
    used_mm = tuple(pose.pupil_mm for pose in poses)
    retinas = _remember(frame, eyes, used_mm, adapted_cd_m2, state, dt_s, effects)
    kernels = clock.time(
        "kernel",
        lambda: tuple(
            mixture(effects.glare.model, observer, pose, luminance_cd_m2, frame.view.ppd_centre)
            for pose, luminance_cd_m2 in zip(poses, adapted_cd_m2, strict=True)
        ),
    )
    targets = [one.tone_target_cd_m2(effects.adaptation) for one in adapted]
    seen = [
        Eye(
            measured=measured[k],
            adapted=adapted[k],
            kernel=kernels[k],
            gaze_px=frame.view.pixel_of(one.azimuth_deg, one.elevation_deg),
            pupil_mm=used_mm[k],
            ceiling_cd_m2=(
                tone.full_cd_m2(adapted_cd_m2[k], targets[k], effects.tone, display)
                if effects.glare.above_display
                else None
            ),
            retina=retinas[k] if retinas else None,
        )
        for k, one in enumerate(eyes)
    ]
    planned = clock.time(
        "plan",
        lambda: make_plan(
            seen,
            _scenery(frame),
            effects,
            display,
            planning,
            before=None if state is None else state.choices,
            dt_s=dt_s,
            costs=costs,
        ),
    )
    plan = planned.plan
    elapsed_s = 0.0 if state is None else state.elapsed_s + max(dt_s, 0.0)
    rgb, glared = frame.rgb_cd_m2, None

    def glare_at(level: str) -> Float[Array, "eye 3 y x"]:
        nonlocal glared
        settings = msgspec.structs.replace(effects.glare, level=GlareLevel(level))
        sights = [
            Sight(
                view=frame.view,
                measured=eye.measured,
                gaze_px=eye.gaze_px,
                kernel=eye.kernel,
                observer=observer,
                pose=poses[k],
                adapted_cd_m2=adapted_cd_m2[k],
                ceiling_cd_m2=eye.ceiling_cd_m2,
                lights=frame.lights,
            )
            for k, eye in enumerate(seen)
        ]
        glared = _glare(frame, sights, settings, None if state is None else state.glared)
        return glared.result

    rgb = clock.step(plan[Effect.GLARE], rgb, glare_at)
    rgb = clock.step(
        plan[Effect.ACUITY],
        rgb,
        lambda level: acuity.reduce_acuity(
            rgb, frame.view.ppd_centre, effects.acuity, planned.dark, measured[0].range_cd_m2.tile_px
        ),
    )
    rgb = clock.step(
        plan[Effect.ROD_NOISE],
        rgb,
        lambda level: rod_noise.add_noise(rgb, elapsed_s, used_mm, frame.view.ppd_centre, effects.rod_noise),
    )
    shown = clock.time(Effect.TONE, lambda: tone.show(rgb, adapted_cd_m2, targets, effects.tone, display))
    shown = clock.step(
        plan[Effect.NIGHT_COLOUR],
        shown,
        lambda level: night_colour.shift(shown, adapted_cd_m2, effects.night_colour, rgb),
    )
    shown = clock.step(
        plan[Effect.AFTERIMAGE],
        shown,
        lambda level: afterimage.show(shown, retinas, frame.view, [eye.gaze_px for eye in seen]),
    )
    image = clock.time("encode", lambda: encode(shown, display))
    after = RenderState(adapted_cd_m2, moving, glared, adapted, retinas, planned.choices, elapsed_s)
    reused = glared is not None and state is not None and glared is state.glared
    return Perceived(image, shown, plan, after, measured, used_mm, kernels, reused, clock.milliseconds)


def as_displayed(frame: Frame, display: Display = Display()) -> np.ndarray:
    """A frame as a renderer without an eye shows it: exposed for middle grey, tone-mapped, encoded for the display."""
    mean_log = np.asarray(_mean_log(frame.rgb_cd_m2))
    return encode(tone.aces(frame.rgb_cd_m2, DISPLAY_KEY / np.exp(mean_log), seen_peak_cd_m2(display)), display)


@jax.jit
def _mean_log(rgb: Float[Array, "eye 3 y x"]) -> Float[Array, "eye"]:
    return jnp.log(luminance(rgb) + np.float32(adaptation.FLOOR_CD_M2)).mean((1, 2))


def _adapt(
    frame: Frame,
    measured: Sequence[Measurement],
    eyes: Sequence[EyePose],
    state: RenderState | None,
    dt_s: float,
    effects: Effects,
) -> tuple[Adapted, ...]:
    settings = effects.adaptation
    targets = [
        adaptation.target_cd_m2(image, eye.azimuth_deg, eye.elevation_deg, settings, frame.all_around_cd_m2)
        for image, eye in zip(measured, eyes, strict=True)
    ]
    pupils = [PUPIL_MM if eye.pupil_mm is None else eye.pupil_mm for eye in eyes]
    if state is None:
        return tuple(adaptation.begin(target, settings, mm) for target, mm in zip(targets, pupils, strict=True))
    before = state.adapted or [
        adaptation.begin(cd_m2, settings, mm) for cd_m2, mm in zip(state.adapted_cd_m2, pupils, strict=True)
    ]
    return tuple(
        adaptation.step(one, target, dt_s, settings, mm)
        for one, target, mm in zip(before, targets, pupils, strict=True)
    )


def _remember(
    frame: Frame,
    eyes: Sequence[EyePose],
    pupils: Sequence[float],
    adapted_cd_m2: Sequence[float],
    state: RenderState | None,
    dt_s: float,
    effects: Effects,
) -> tuple[Retina, ...]:
    if not effects.afterimage.on:
        return ()
    before = () if state is None else state.retinas
    return tuple(
        afterimage.step(
            retina,
            frame.rgb_cd_m2,
            frame.view,
            frame.view.pixel_of(eye.azimuth_deg, eye.elevation_deg),
            image=k,
            pupil_mm=pupils[k],
            openness=eye.openness,
            dt_s=dt_s,
            exposure=adaptation.exposure(adapted_cd_m2[k]),
        )
        for k, (retina, eye) in enumerate(
            zip(before or (afterimage.rested(effects.afterimage),) * len(eyes), eyes, strict=True)
        )
    )


def _scenery(frame: Frame) -> Scenery:
    eyes, _, height, width = frame.rgb_cd_m2.shape
    return Scenery(eyes * height * width / 1e6, len(frame.lights))


def _pupils(view: View, eyes: Sequence[EyePose], adapted: Sequence[float], observer: Observer) -> tuple[float, ...]:
    field_deg2 = view.fov_deg * math.degrees(2 * math.atan(view.height_px / 2 / view.focal_px))
    return tuple(
        watson_yellott_mm(luminance_cd_m2, field_deg2, observer.age_years) if eye.pupil_mm is None else eye.pupil_mm
        for eye, luminance_cd_m2 in zip(eyes, adapted, strict=True)
    )


def _move(
    observer: Observer, eyes: Sequence[EyePose], pupils: Sequence[float], state: RenderState | None, dt_s: float
) -> tuple[OcularState, ...]:
    before = () if state is None else state.ocular
    return tuple(
        ocular_dynamics.step(motion, observer, dt_s, pupil_mm, eye.saccade_impulses)
        for motion, pupil_mm, eye in zip(
            before or (ocular_dynamics.at_rest(observer),) * len(eyes), pupils, eyes, strict=True
        )
    )


def _glare(frame: Frame, sights: Sequence[Sight], settings: Glare, before: Glared | None) -> Glared:
    """The frame with its glare: the one before, where nothing changed."""
    cause = (settings, *(what for sight in sights for what in sight.cause(settings)))
    if before is not None and before.rgb_cd_m2 is frame.rgb_cd_m2 and before.cause == cause:
        return before
    images = [scatter(frame.rgb_cd_m2[k], sight, settings) for k, sight in enumerate(sights)]
    result = _alone(images[0]) if len(images) == 1 else jnp.stack(images)
    # Waited for here: the clock does not see into a record.
    return Glared(frame.rgb_cd_m2, cause, jax.block_until_ready(result))


@functools.partial(jax.jit, donate_argnums=0)
def _alone(image: Float[Array, "3 y x"]) -> Float[Array, "1 3 y x"]:
    """One eye's image as a frame, in the same memory."""
    return image[None]


@jax.jit
def _mix(one: Float[Array, "eye 3 y x"], other: Float[Array, "eye 3 y x"], weight: float) -> Float[Array, "eye 3 y x"]:
    return (one * jnp.float32(weight) + other * (1 - jnp.float32(weight))).astype(jnp.float32)


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

    def step(
        self, step: Step, before: Float[Array, "eye 3 y x"], run: Callable[[str], Float[Array, "eye 3 y x"]]
    ) -> Float[Array, "eye 3 y x"]:
        """A frame after one effect: at its level, or between two."""
        if not step.runs:
            return before

        def weighed() -> Float[Array, "eye 3 y x"]:
            first, *second = [before if level == SKIPPED else run(level) for level in step.weights]
            return _mix(first, *second, step.fade) if second else first

        return self.time(step.effect, weighed)
