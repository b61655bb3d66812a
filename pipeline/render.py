"""Measures a frame, plans, and runs the plan: what one person's eyes make of one frame."""

from __future__ import annotations

import dataclasses
import functools
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
from entoptic.pipeline.effects.effect import SKIPPED, Domain, Effect, Picture
from entoptic.pipeline.effects.encode import encode
from entoptic.pipeline.effects.pointwise import Pointwise, encoded_after, image_after
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.eye_pose import EyePose
from entoptic.pipeline.frame import Display, Frame, FrameError
from entoptic.pipeline.measure import Measurement, luminance, measure
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.plan import Plan, Planned, Planning, Step, make_plan
from entoptic.pipeline.viewing import RenderState, Reusable, prepare, view_frame

LEAST_MS = 0.01
"""What a part of a pass counts at least where it took more than was expected. Engineering choice: more than 0."""
DISPLAY_KEY = 0.18
"""Middle grey of ordinary auto-exposure (Reinhard 2002)."""


@dataclasses.dataclass(frozen=True)
class Perceived:
    """What became of a frame."""

    image: np.ndarray
    """(eye, y, x, 3): what the display is sent. uint8 code values of sRGB unless the display says otherwise."""
    drawn: Drawn
    """The images before the last pass, of which `image` came."""
    plan: Plan
    state: RenderState
    """Pass it on with the next frame."""
    eyes: tuple[EyeContext, ...]
    """Each eye as it viewed the frame: what was measured, its adaptation, its pupil, its kernel for glare."""
    reused: frozenset[str]
    """Effects whose last result served again, since nothing changed that they depend on."""
    milliseconds: dict[str, float]
    """Of `measure`, `kernel` (what effects prepare), `plan`, each effect that ran, and `encode`, each to its end.

    Effects that ran in one pass over memory, and encoding with them, were not timed apart: the pass's time is shared
    among them in proportion to what the cost model says that each takes.
    """

    @functools.cached_property
    def linear(self) -> Float[Array, "eye 3 y x"]:
        """`image` before encoding, linear Rec.709, 1 = the display's peak: made when asked for, so it costs a pass."""
        return image_after(self.drawn.picture, self.drawn.last) if self.drawn.last else self.drawn.picture.image

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
    clock = _Clock()
    begun = _begin(frame, eye, observer, display, state, dt_s, effects, planning, costs, clock)
    drawn = begun.drawing.drawn(Picture(frame.rgb_cd_m2, frame.rgb_cd_m2))
    encoded = clock.together([*drawn.names, "encode"], lambda: encoded_after(drawn.picture, drawn.last, display))
    after = dataclasses.replace(begun.state, reusable=begun.drawing.reusable)
    reused = frozenset(begun.drawing.reused)
    return Perceived(encoded, drawn, begun.planned.plan, after, begun.eyes, reused, clock.milliseconds)


def light_after(
    effect: str,
    frame: Frame,
    eye: EyePose | Sequence[EyePose] = EyePose(),
    *,
    observer: Observer = Observer(),
    display: Display = Display(),
    state: RenderState | None = None,
    effects: Effects = Effects(),
    planning: Planning = Planning(),
    costs: CostModel = SHIPPED,
) -> tuple[Float[Array, "eye 3 y x"], Plan]:
    """The images as one of EFFECTS leaves them by the plan, linear Rec.709 in cd/m², and the plan.

    Before tone mapping that is the scene's light, from then on the display's, with what the screen reflects. Raises
    FrameError where no effect has that name.
    """
    if (last := next((one for one in EFFECTS if one.name == effect), None)) is None:
        raise FrameError(f"{effect} is no effect: choose one of {', '.join(one.name for one in EFFECTS)}")
    clock = _Clock()
    begun = _begin(frame, eye, observer, display, state, 0.0, effects, planning, costs, clock)
    image = begun.drawing.drawn(Picture(frame.rgb_cd_m2, frame.rgb_cd_m2), last).with_pass(clock).picture.image
    return image if last.domain is Domain.SCENE else image * seen_peak_cd_m2(display), begun.planned.plan


@dataclasses.dataclass(frozen=True, eq=False)
class _Begun:
    """All that is known before a frame is drawn."""

    eyes: tuple[EyeContext, ...]
    planned: Planned
    state: RenderState
    """For the next frame, without what drawing leaves behind."""
    drawing: _Drawing


def _begin(
    frame: Frame,
    eye: EyePose | Sequence[EyePose],
    observer: Observer,
    display: Display,
    state: RenderState | None,
    dt_s: float,
    effects: Effects,
    planning: Planning,
    costs: CostModel,
    clock: _Clock,
) -> _Begun:
    images = frame.rgb_cd_m2.shape[0]
    poses = (eye,) * images if isinstance(eye, EyePose) else tuple(eye)
    if len(poses) != images or (state is not None and len(state.adapted_cd_m2) != images):
        raise FrameError(f"a frame of {images} images for {len(poses)} eyes: give one for each")
    measured = clock.time("measure", lambda: measure(frame))
    viewing = clock.time(
        "adaptation", lambda: view_frame(frame, measured, poses, observer, display, effects, state, dt_s)
    )
    eyes = clock.time("kernel", lambda: prepare(viewing.eyes))
    choices, found = (None, None) if state is None else (state.choices, state.found)
    planned = clock.time("plan", lambda: make_plan(eyes, planning, before=choices, found=found, dt_s=dt_s, costs=costs))
    clock.expected = {
        part: costs.ms(part, level, frame.rgb_cd_m2.size / 3e6)
        for part, level in [*((step.effect, step.level) for step in planned.plan if step.runs), ("encode", "whole")]
    }
    after = dataclasses.replace(viewing.state, choices=planned.choices, found=planned.found)
    return _Begun(eyes, planned, after, _Drawing(eyes, planned, {} if state is None else state.reusable, clock))


def as_displayed(frame: Frame, display: Display = Display()) -> np.ndarray:
    """A frame as a renderer without an eye shows it: exposed for middle grey, tone-mapped, encoded for the display."""
    mean_log = np.asarray(_mean_log(frame.rgb_cd_m2))
    return encode(tone.aces(frame.rgb_cd_m2, DISPLAY_KEY / np.exp(mean_log), seen_peak_cd_m2(display)), display)


@jax.jit
def _mean_log(rgb: Float[Array, "eye 3 y x"]) -> Float[Array, "eye"]:
    return jnp.log(luminance(rgb) + np.float32(FLOOR_CD_M2)).mean((1, 2))


@dataclasses.dataclass(frozen=True, eq=False)
class Drawn:
    """All eyes' images before the last pass over memory, and what that pass is made of."""

    picture: Picture
    last: tuple[Pointwise, ...] = ()
    names: tuple[str, ...] = ()
    """Of the effects in the last pass."""

    def with_pass(self, clock: _Clock) -> Drawn:
        """The same with the last pass done, in the unit of the domain that it reached."""
        picture = self.picture
        # Apart: effects that follow may need the scene as well as what is displayed of it.
        for domain in Domain:
            named = [(one, name) for one, name in zip(self.last, self.names, strict=True) if one.domain is domain]
            if named:
                part, names = zip(*named, strict=True)
                image = clock.together(names, functools.partial(image_after, picture, part))
                picture = picture.after(image, domain)
        return Drawn(picture)


class _Drawing:
    """Runs one frame's plan: each effect at its level, or between two; neighbours that allow it in one pass."""

    def __init__(
        self, eyes: Sequence[EyeContext], planned: Planned, reusable: Mapping[str, Reusable], clock: _Clock
    ) -> None:
        self._eyes, self._planned, self._before, self._clock = eyes, planned, reusable, clock
        self.reusable: dict[str, Reusable] = {}
        self.reused: set[str] = set()

    def drawn(self, picture: Picture, last: Effect[Any, Any] | None = None) -> Drawn:
        """What becomes of it by the plan, up to the last effect if one is named."""
        drawn = Drawn(picture)
        for effect in EFFECTS:
            if (step := self._planned.plan[effect.name]).runs:
                drawn = self._after(drawn, effect, step)
            elif effect.left_out(drawn.picture, self._eyes) is not drawn.picture.image:
                drawn = drawn.with_pass(self._clock)
                drawn = Drawn(drawn.picture.after(effect.left_out(drawn.picture, self._eyes), effect.domain))
            if effect is last:
                break
        return drawn

    def _after(self, drawn: Drawn, effect: Effect[Any, Any], step: Step) -> Drawn:
        if effect.needs_picture:
            drawn = drawn.with_pass(self._clock)
        settings, tiles = effect.settings_of(self._eyes[0].effects), self._planned.tiles.get(effect.name)
        if len(step.weights) == 1:
            pointwise = self._clock.time(
                effect.name, lambda: effect.pointwise(drawn.picture, self._eyes, settings, step.level, tiles)
            )
            if pointwise is not None:
                return Drawn(drawn.picture, (*drawn.last, pointwise), (*drawn.names, effect.name))
        drawn = drawn.with_pass(self._clock)
        image = self._clock.time(effect.name, lambda: self._image(drawn.picture, effect, step, settings, tiles))
        return Drawn(drawn.picture.after(image, effect.domain))

    def _image(
        self, picture: Picture, effect: Effect[Any, Any], step: Step, settings: Any, tiles: NDArray[np.bool_] | None
    ) -> Float[Array, "eye 3 y x"]:
        first, *second = [
            effect.left_out(picture, self._eyes)
            if level == SKIPPED
            else self._at(level, picture, effect, settings, tiles)
            for level in step.weights
        ]
        return _mix(first, *second, step.fade) if second else first

    def _at(
        self, level: str, picture: Picture, effect: Effect[Any, Any], settings: Any, tiles: NDArray[np.bool_] | None
    ) -> Float[Array, "eye 3 y x"]:
        name, eyes, last = effect.name, self._eyes, self._before.get(effect.name)
        cause = effect.cause(eyes, settings, level)
        if cause is None:
            return effect.apply(picture, eyes, settings, level, tiles)
        if last is not None and last.image is picture.image and last.cause == cause:
            self.reused.add(name)
            self.reusable[name] = last
        else:
            result = jax.block_until_ready(effect.apply(picture, eyes, settings, level, tiles))
            self.reusable[name] = Reusable(picture.image, cause, result)
        return self.reusable[name].result


@jax.jit
def _mix(one: Float[Array, "eye 3 y x"], other: Float[Array, "eye 3 y x"], weight: float) -> Float[Array, "eye 3 y x"]:
    return (one * jnp.float32(weight) + other * (1 - jnp.float32(weight))).astype(jnp.float32)


Result = TypeVar("Result")


class _Clock:
    """Times each part to its end, not to its dispatch."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}
        self.expected: dict[str, float] = {}
        """Of each part, by the cost model."""

    def time(self, part: str, run: Callable[[], Result]) -> Result:
        """What `run` gives; its time adds to that of the part."""
        return self.together((part,), run)

    def together(self, parts: Sequence[str], run: Callable[[], Result]) -> Result:
        """What `run` gives. Its time is shared among the parts by what each has still to take by the cost model."""
        begun = time.perf_counter()
        result = jax.block_until_ready(run())
        took_ms = (time.perf_counter() - begun) * 1e3
        so_far = [self.milliseconds.get(part, 0.0) for part in parts]
        left = [
            max(self.expected.get(part, 0.0) - before, LEAST_MS) for part, before in zip(parts, so_far, strict=True)
        ]
        for part, before, share in zip(parts, so_far, left, strict=True):
            self.milliseconds[part] = before + took_ms * share / sum(left)
        return result
