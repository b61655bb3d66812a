"""Eyes viewing a frame: how each has adapted and moved since the frame before, and what it remembers."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import msgspec
from jaxtyping import Array, Float

from entoptic.pipeline.budget import Choice
from entoptic.pipeline.effects import EFFECTS, Effects
from entoptic.pipeline.effects.adaptation import Adapted, begin, step, target_cd_m2
from entoptic.pipeline.effects.adaptation.pigments import PUPIL_MM
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.eye_pose import EyePose
from entoptic.pipeline.frame import Display, Frame
from entoptic.pipeline.measure import Measurement
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import ocular_dynamics
from entoptic.pipeline.optics.ocular_dynamics import OcularState
from entoptic.pipeline.optics.pupil import expected_mm
from entoptic.pipeline.plan.reasons import Reduced

if TYPE_CHECKING:

    class Memories(msgspec.Struct, frozen=True):
        """What each effect's eyes remember: one field an effect that remembers, a tuple with one record an eye."""

        def __init__(self, **memories: tuple[Any, ...]) -> None: ...

else:
    Memories = msgspec.defstruct(
        "Memories",
        [(effect.name, tuple[effect.Memory, ...], ()) for effect in EFFECTS if effect.Memory is not None],
        module=__name__,
        frozen=True,
    )


@dataclasses.dataclass(frozen=True, eq=False)
class Reusable:
    """What an effect made of a frame, and of what."""

    image: Float[Array, "eye 3 y x"]
    cause: tuple[object, ...]
    result: Float[Array, "eye 3 y x"]


@dataclasses.dataclass(frozen=True)
class RenderState:
    """What the eyes, and planning, remember from one frame to the next."""

    adapted_cd_m2: tuple[float, ...]
    """The luminance each eye is adapted to."""
    ocular: tuple[OcularState, ...] = ()
    """What of each eye is in motion; empty: all at rest."""
    adapted: tuple[Adapted, ...] = ()
    """All that adaptation takes along; empty: each eye has looked at its luminance for long."""
    memories: Memories = dataclasses.field(default_factory=Memories)
    """What effects remember."""
    choices: Mapping[str, Choice] = dataclasses.field(default_factory=dict)
    """Levels of the effects, and fades between them."""
    elapsed_s: float = 0.0
    """Since the first frame."""
    reusable: Mapping[str, Reusable] = dataclasses.field(default_factory=dict)
    """Results that serve again while nothing changes, by effect: a cache, without which the same comes."""
    found: Mapping[str, Mapping[str, Reduced]] = dataclasses.field(default_factory=dict)
    """What planning found of each effect's levels: see `make_plan`."""


@dataclasses.dataclass(frozen=True, eq=False)
class Viewing:
    """The eyes before a frame, and what is to be remembered of them."""

    eyes: tuple[EyeContext, ...]
    state: RenderState
    """Of the eyes alone: without choices and results."""


def view_frame(
    frame: Frame,
    measured: Sequence[Measurement],
    poses: Sequence[EyePose],
    observer: Observer,
    display: Display,
    effects: Effects,
    before: RenderState | None,
    dt_s: float,
) -> Viewing:
    """The eyes `dt_s` after `before`; without it fully adapted to this frame and at rest."""
    adapted = _adapted(frame, measured, poses, effects, before, dt_s)
    elapsed_s = 0.0 if before is None else before.elapsed_s + max(dt_s, 0.0)
    pupil_diameters_mm = [
        expected_mm(frame.view, one.luminance_cd_m2, observer.age_years)
        if pose.pupil_diameter_mm is None
        else pose.pupil_diameter_mm
        for one, pose in zip(adapted, poses, strict=True)
    ]
    at_rest = (ocular_dynamics.at_rest(observer),) * len(poses)
    ocular = tuple(
        ocular_dynamics.step(motion, observer, dt_s, pupil_diameter_mm, pose.saccade_impulses)
        for motion, pupil_diameter_mm, pose in zip(
            (before and before.ocular) or at_rest, pupil_diameters_mm, poses, strict=True
        )
    )
    eyes = []
    for k, pose in enumerate(poses):
        aperture = ocular_dynamics.pose_of(
            ocular[k], observer, pupil_diameters_mm[k], pose.openness, measured=pose.pupil_diameter_mm is not None
        )
        eye = EyeContext(
            frame=frame,
            image=k,
            pose=pose,
            measured=measured[k],
            observer=observer,
            display=display,
            effects=effects,
            time_s=elapsed_s,
            adapted=adapted[k],
            pupil_diameter_mm=aperture.pupil_diameter_mm,
            aperture=aperture,
        )
        eyes.append(dataclasses.replace(eye, memory=_remembered(eye, before, dt_s)))
    memories = {
        name: tuple(eye.memory[name] for eye in eyes) for name in eyes[0].memory if name in Memories.__struct_fields__
    }
    state = RenderState(
        tuple(one.luminance_cd_m2 for one in adapted), ocular, adapted, Memories(**memories), elapsed_s=elapsed_s
    )
    return Viewing(tuple(eyes), state)


def prepare(eyes: Sequence[EyeContext]) -> tuple[EyeContext, ...]:
    """The eyes with what effects work out before planning."""
    prepared = []
    for eye in eyes:
        made: dict[str, Any] = {}
        for effect in EFFECTS:
            settings = effect.settings_of(eye.effects)
            if effect.is_on(settings) and (found := effect.prepare(eye, settings)) is not None:
                made[effect.name] = found
        prepared.append(dataclasses.replace(eye, prepared=made))
    return tuple(prepared)


def _adapted(
    frame: Frame,
    measured: Sequence[Measurement],
    poses: Sequence[EyePose],
    effects: Effects,
    before: RenderState | None,
    dt_s: float,
) -> tuple[Adapted, ...]:
    settings = effects.adaptation
    targets = [
        target_cd_m2(image, pose.azimuth_deg, pose.elevation_deg, settings, frame.all_around_cd_m2)
        for image, pose in zip(measured, poses, strict=True)
    ]
    pupils = [PUPIL_MM if pose.pupil_diameter_mm is None else pose.pupil_diameter_mm for pose in poses]
    if before is None:
        return tuple(begin(target, settings, mm) for target, mm in zip(targets, pupils, strict=True))
    adapted = before.adapted or [
        begin(cd_m2, settings, mm) for cd_m2, mm in zip(before.adapted_cd_m2, pupils, strict=True)
    ]
    return tuple(
        step(one, target, dt_s, settings, mm) for one, target, mm in zip(adapted, targets, pupils, strict=True)
    )


def _remembered(eye: EyeContext, before: RenderState | None, dt_s: float) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for effect in EFFECTS:
        settings = effect.settings_of(eye.effects)
        if effect.Memory is None or not effect.is_on(settings):
            continue
        earlier = () if before is None else getattr(before.memories, effect.name)
        memory = effect.remember(earlier[eye.image] if earlier else None, eye, settings, dt_s)
        if memory is not None:
            found[effect.name] = memory
    return found
