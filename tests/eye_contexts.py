"""Eyes viewing a frame, for tests of one effect alone."""

import math

import jax.numpy as jnp
import numpy as np

from entoptic.pipeline import Display, Effects, EyeContext, EyePose, Frame, GlareLevel, Light, Observer, View
from entoptic.pipeline.effects.glare import Mixture, glare
from entoptic.pipeline.effects.glare.scatter import DARKNESS
from entoptic.pipeline.measure import measure
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.viewing import view_frame


def viewing(frame: Frame, pose: EyePose = EyePose(), observer: Observer = Observer(), **effects: object) -> EyeContext:  # noqa: B008
    return view_frame(frame, measure(frame), (pose,), observer, Display(), Effects(**effects), None, 0.0).eyes[0]


def looking_at(view: View, x_px: float, y_px: float, pupil_diameter_mm: float) -> EyePose:
    azimuth = math.atan((x_px - view.width_px / 2) / view.focal_px)
    elevation = math.atan((view.height_px / 2 - y_px) / view.focal_px * math.cos(azimuth))
    return EyePose(math.degrees(azimuth), math.degrees(elevation), pupil_diameter_mm)


def glared(
    rgb: np.ndarray,
    view: View,
    mixture: Mixture,
    level: GlareLevel = GlareLevel.QUARTER,
    *lights: Light,
    beyond_cd_m2: np.ndarray = DARKNESS,
) -> np.ndarray:
    """One image (3, y, x) with the glare of a function, by an eye whose pupil is 5 mm wide."""
    eye = Observer(gratings=60), Pose(5.0)
    image = glare(jnp.array(rgb, jnp.float32), view, mixture, level, None, lights, *eye, beyond_cd_m2)
    return np.asarray(image, np.float64)
