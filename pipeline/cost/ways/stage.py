"""One eye before one scene: what each effect starts from, and what becomes of its image on the display."""

from __future__ import annotations

import dataclasses
import functools
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.cost.plain import acuity, night_colour, tone
from entoptic.pipeline.cost.scenes import CostScene, straight_ahead
from entoptic.pipeline.effects.glare import Glare, GlareLevel, GlareModel, Mixture, PreparedGlare, mixture, scatter
from entoptic.pipeline.effects.tone import ceiling_cd_m2
from entoptic.pipeline.frame import Display
from entoptic.pipeline.measure import Measurement, measure
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.pupil import watson_yellott_mm

Reals = NDArray[np.float64]

BEFORE_TONE = ("adaptation", "glare", "acuity", "rod_noise")
PUPIL_STEP_MM = 0.5
"""Pupils are rounded to this. Engineering choice: scenes that are alike then share their kernels."""


@dataclasses.dataclass(frozen=True, eq=False)
class Stage:
    """One eye, adapted, that looks straight ahead at a scene; its pupil as Watson & Yellott expect."""

    scene: CostScene
    observer: Observer = Observer()
    display: Display = Display()

    @functools.cached_property
    def pose(self) -> Pose:
        """The pupil of this light."""
        view = self.scene.frame.view
        field_deg2 = view.fov_deg * math.degrees(2 * math.atan(view.height_px / 2 / view.focal_px))
        pupil_mm = watson_yellott_mm(self.adapted_cd_m2, field_deg2, self.observer.age_years)
        return Pose(min(max(round(pupil_mm / PUPIL_STEP_MM) * PUPIL_STEP_MM, 2.0), 8.0))

    @property
    def adapted_cd_m2(self) -> float:
        """The luminance that the eye is adapted to."""
        return self.scene.adapted_cd_m2

    @property
    def exposure(self) -> float:
        """1/(cd/m²)."""
        return self.scene.exposure

    @property
    def rgb(self) -> Float[Array, "3 y x"]:
        """The scene, cd/m²."""
        return self.scene.frame.rgb_cd_m2[0]

    def kernel(self, model: GlareModel = GlareModel.WAVE) -> Mixture:
        """The eye's point-spread function; kept by models.py."""
        return mixture(model, self.observer, self.pose, self.adapted_cd_m2, self.scene.frame.view.ppd_centre)

    def glare(self, settings: Glare) -> Float[Array, "3 y x"]:
        """The scene with glare, cd/m², as the program makes it."""
        ceiling = ceiling_cd_m2(self.exposure, self.display.peak_cd_m2) if settings.above_display else None
        prepared = PreparedGlare(self.kernel(settings.model), ceiling)
        return scatter(
            self.rgb, straight_ahead(self.scene.frame, self.observer, self.pose), prepared, settings, settings.level
        )

    @functools.cached_property
    def glared(self) -> Float[np.ndarray, "3 y x"]:
        """What acuity starts from: the scene with the glare of all its light."""
        return np.maximum(np.asarray(self.glare(Glare(level=GlareLevel.FRAME))), 0)

    @functools.cached_property
    def measured_glared(self) -> Measurement:
        """What that contains."""
        return measure(dataclasses.replace(self.scene.frame, rgb_cd_m2=jnp.asarray(self.glared)[None]))[0]

    @functools.cached_property
    def resolved(self) -> Float[np.ndarray, "3 y x"]:
        """What tone mapping starts from, cd/m²."""
        return acuity.fit(self.glared.astype(np.float64)).astype(np.float32)

    @functools.cached_property
    def shown(self) -> Float[np.ndarray, "3 y x"]:
        """What night colour starts from: linear, 1 = the display's peak."""
        return self._toned(self.resolved.astype(np.float64)).astype(np.float32)

    @functools.cached_property
    def tinted(self) -> Float[np.ndarray, "3 y x"]:
        """What encoding starts from."""
        return np.clip(night_colour.night_tint(self.shown.astype(np.float64), self.adapted_cd_m2), 0, 1).astype(
            np.float32
        )

    def _toned(self, image: Reals) -> Reals:
        return tone.aces(image, self.exposure, self.display.peak_cd_m2)

    def on_display(self, effect: str, image: Reals) -> Reals:
        """What becomes of an effect's image in all that follows, plainly; in the display's cd/m²."""
        if effect == "glare":
            image = acuity.fit(np.maximum(image, 0))
        if effect in BEFORE_TONE:
            image = self._toned(image)
        if effect in (*BEFORE_TONE, "tone"):
            image = night_colour.night_tint(image, self.adapted_cd_m2)
        return np.clip(image, 0, 1) * self.display.peak_cd_m2
