"""One eye viewing one scene: what each effect starts from, and what becomes of its image on the display."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import msgspec
import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline.cost.scenes import CostScene
from entoptic.pipeline.effects import EFFECTS, Effects
from entoptic.pipeline.effects.effect import Domain, Effect, Picture
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.eye_pose import EyePose
from entoptic.pipeline.frame import Display
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.pupil import expected_mm
from entoptic.pipeline.viewing import prepare, view_frame

AnyEffect = Effect[Any, Any]
Reals = NDArray[np.float64]

PUPIL_STEP_MM = 0.5
"""Pupils are rounded to this. Engineering choice: scenes that are alike then share their kernels."""
STARED_S, ASIDE_DEG = 10.0, 8.0
"""How long the eye has looked straight ahead, and how far to the right it looks for effects that remember. Engineering
choice: long enough to bleach, far enough for an afterimage to lie on other things than its cause."""
DEFAULT = Effects()


class SceneViewing:
    """One adapted eye that looks straight ahead at a scene; its pupil as Watson & Yellott expect."""

    def __init__(
        self, scene: CostScene, observer: Observer = Observer(), display: Display = Display(), *, exact: bool = True
    ) -> None:
        """`exact`: effects start from what oracles made; else from what the program itself makes, to be timed."""
        self.scene, self.observer, self.display, self._exact = scene, observer, display, exact
        pupil_diameter_mm = expected_mm(scene.frame.view, scene.adapted_cd_m2, observer.age_years)
        self.pupil_diameter_mm = min(max(round(pupil_diameter_mm / PUPIL_STEP_MM) * PUPIL_STEP_MM, 2.0), 8.0)
        self._before: dict[str, Picture] = {}

    def eye(self, effect: AnyEffect, settings: msgspec.Struct) -> EyeContext:
        """The eye with these settings of one effect, all others' defaults; looking aside where the effect remembers."""
        aside_deg = 0.0 if effect.Memory is None else ASIDE_DEG
        effects, before = Effects(**{effect.name: settings}), None
        for azimuth_deg, dt_s in ((0.0, 0.0), (0.0, STARED_S), (aside_deg, 0.0)):
            poses, measured = (EyePose(azimuth_deg, 0.0, self.pupil_diameter_mm),), (self.scene.measured,)
            viewing = view_frame(self.scene.frame, measured, poses, self.observer, self.display, effects, before, dt_s)
            before = viewing.state
        return prepare(viewing.eyes)[0]

    def before(self, effect: AnyEffect) -> Picture:
        """What an effect starts from, float32: the scene after all before it, by their oracles.

        One that draws nothing changes an exposure, and is judged where tone mapping begins.
        """
        if not self._before:
            picture = Picture(self.scene.frame.rgb_cd_m2, self.scene.frame.rgb_cd_m2)
            for one in EFFECTS:
                self._before[one.name] = picture
                picture = self._through(one, picture)
        return self._before[(effect if draws(effect) else _first_on_display()).name]

    def on_display(self, effect: AnyEffect, image: Reals) -> Reals:
        """What the display shows, in cd/m², of an effect's image (3, y, x) after all that follow, by their oracles."""
        first = EFFECTS.index(effect) + 1 if draws(effect) else EFFECTS.index(_first_on_display())
        picture = self.before(effect).after(jnp.asarray(image, jnp.float32)[None], effect.domain)
        for one in EFFECTS[first:]:
            picture = self._through(one, picture)
        return np.clip(np.asarray(picture.image[0], np.float64), 0, 1) * self.display.peak_cd_m2

    def _through(self, effect: AnyEffect, picture: Picture) -> Picture:
        settings = effect.settings_of(DEFAULT)
        if not effect.is_on(settings) or not draws(effect):
            return picture
        eye = self.eye(effect, settings)
        if not self._exact:
            return picture.after(
                effect.apply(picture, [eye], settings, effect.full_level(settings), None), effect.domain
            )
        image = effect.oracle(picture, eye, settings)
        # A spectral colour of glare lies outside Rec.709: what follows has it as black.
        return picture.after(jnp.asarray(np.maximum(image, 0), jnp.float32)[None], effect.domain)


def draws(effect: AnyEffect) -> bool:
    """Whether it makes another image at all."""
    return effect.optional or effect.domain is Domain.DISPLAY


def _first_on_display() -> AnyEffect:
    return next(one for one in EFFECTS if one.domain is Domain.DISPLAY)
