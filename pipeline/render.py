"""Measures a frame, plans, and runs the plan: what one person's eyes make of one frame."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.budget import SHIPPED, CostModel, Timing
from entoptic.pipeline.display_light import seen_peak_cd_m2
from entoptic.pipeline.effects import EFFECTS, Effects, tone
from entoptic.pipeline.effects.adaptation import FLOOR_CD_M2
from entoptic.pipeline.effects.effect import SKIPPED, Effect, Picture
from entoptic.pipeline.effects.encode import encode
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.eye_pose import EyePose
from entoptic.pipeline.frame import Display, Frame, FrameError
from entoptic.pipeline.measure import Measurement, luminance, measure
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.plan import Plan, Planning, Step, make_plan
from entoptic.pipeline.viewing import RenderState, Reusable, prepare, view_frame

DISPLAY_KEY = 0.18
"""Middle grey of ordinary auto-exposure (Reinhard 2002)."""


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
    eyes: tuple[EyeContext, ...]
    """Each eye as it viewed the frame: what was measured, its adaptation, its pupil, its kernel for glare."""
    reused: frozenset[str]
    """Effects whose last result served again, since nothing changed that they depend on."""
    milliseconds: dict[str, float]
    """Of `measure`, `kernel` (what effects prepare), `plan`, each effect that ran, and `encode`, each to its end."""

    @property
    def measured(self) -> tuple[Measurement, ...]:
        """What each eye's image contains."""
        return tuple(eye.measured for eye in self.eyes)

    @property
    def pupil_diameter_mm(self) -> tuple[float, ...]:
        """The diameters that were used."""
        return tuple(eye.pupil_diameter_mm for eye in self.eyes)

    @property
    def timings(self) -> list[Timing]:
        """What took how long, for a cost model; without effects that are between two levels."""
        megapixels = self.image.size / 3e6
        parts = [Timing(part, "whole", megapixels, self.milliseconds[part]) for part in ("measure", "plan", "encode")]
        return parts + [
            Timing(step.effect, step.level, megapixels, self.milliseconds[step.effect])
            for step in self.plan
            if step.effect in self.milliseconds and step.fading_from is None and step.effect not in self.reused
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
    poses = (eye,) * images if isinstance(eye, EyePose) else tuple(eye)
    if len(poses) != images or (state is not None and len(state.adapted_cd_m2) != images):
        raise FrameError(f"a frame of {images} images for {len(poses)} eyes: give one for each")
    clock = _Clock()
    measured = clock.time("measure", lambda: measure(frame))
    viewing = clock.time(
        "adaptation", lambda: view_frame(frame, measured, poses, observer, display, effects, state, dt_s)
    )
    eyes = clock.time("kernel", lambda: prepare(viewing.eyes))
    before = None if state is None else state.choices
    planned = clock.time("plan", lambda: make_plan(eyes, planning, before=before, dt_s=dt_s, costs=costs))
    picture = Picture(frame.rgb_cd_m2, frame.rgb_cd_m2)
    reusable: dict[str, Reusable] = {}
    reused: set[str] = set()
    for effect in EFFECTS:
        if not (step := planned.plan[effect.name]).runs:
            picture = picture.after(effect.left_out(picture, eyes), effect.domain)
            continue
        run = _Run(effect, step, eyes, planned.tiles.get(effect.name), {} if state is None else state.reusable)
        image = clock.time(effect.name, lambda run=run, before=picture: run.image(before))  # type: ignore[misc]
        picture = picture.after(image, effect.domain)
        reusable |= run.reusable
        reused |= run.reused
    encoded = clock.time("encode", lambda: encode(picture.image, display))
    after = dataclasses.replace(viewing.state, choices=planned.choices, reusable=reusable)
    return Perceived(encoded, picture.image, planned.plan, after, eyes, frozenset(reused), clock.milliseconds)


def as_displayed(frame: Frame, display: Display = Display()) -> np.ndarray:
    """A frame as a renderer without an eye shows it: exposed for middle grey, tone-mapped, encoded for the display."""
    mean_log = np.asarray(_mean_log(frame.rgb_cd_m2))
    return encode(tone.aces(frame.rgb_cd_m2, DISPLAY_KEY / np.exp(mean_log), seen_peak_cd_m2(display)), display)


@jax.jit
def _mean_log(rgb: Float[Array, "eye 3 y x"]) -> Float[Array, "eye"]:
    return jnp.log(luminance(rgb) + np.float32(FLOOR_CD_M2)).mean((1, 2))


class _Run:
    """One effect in one frame: at its level, or between two."""

    def __init__(
        self,
        effect: Effect[Any, Any],
        step: Step,
        eyes: Sequence[EyeContext],
        tiles: NDArray[np.bool_] | None,
        reusable: Mapping[str, Reusable],
    ) -> None:
        self._effect, self._step, self._eyes, self._tiles = effect, step, eyes, tiles
        self._last = reusable.get(effect.name)
        self._settings = effect.settings_of(eyes[0].effects)
        self.reusable: dict[str, Reusable] = {}
        self.reused: set[str] = set()

    def image(self, picture: Picture) -> Float[Array, "eye 3 y x"]:
        """The images after it."""
        first, *second = [
            self._effect.left_out(picture, self._eyes) if level == SKIPPED else self._at(level, picture)
            for level in self._step.weights
        ]
        return _mix(first, *second, self._step.fade) if second else first

    def _at(self, level: str, picture: Picture) -> Float[Array, "eye 3 y x"]:
        effect, eyes, last = self._effect, self._eyes, self._last
        cause = effect.cause(eyes, self._settings, level)
        if cause is None:
            return effect.apply(picture, eyes, self._settings, level, self._tiles)
        if last is not None and last.image is picture.image and last.cause == cause:
            self.reused.add(effect.name)
            self.reusable[effect.name] = last
        else:
            result = jax.block_until_ready(effect.apply(picture, eyes, self._settings, level, self._tiles))
            self.reusable[effect.name] = Reusable(picture.image, cause, result)
        return self.reusable[effect.name].result


@jax.jit
def _mix(one: Float[Array, "eye 3 y x"], other: Float[Array, "eye 3 y x"], weight: float) -> Float[Array, "eye 3 y x"]:
    return (one * jnp.float32(weight) + other * (1 - jnp.float32(weight))).astype(jnp.float32)


Result = TypeVar("Result")


class _Clock:
    """Times each part to its end, not to its dispatch."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}

    def time(self, part: str, run: Callable[[], Result]) -> Result:
        """What `run` gives; its time adds to that of the part."""
        begun = time.perf_counter()
        result = jax.block_until_ready(run())
        self.milliseconds[part] = self.milliseconds.get(part, 0.0) + (time.perf_counter() - begun) * 1e3
        return result
