"""Eyes viewing a frame, for tests of one effect alone."""

import dataclasses
import math

import jax.numpy as jnp
import numpy as np

from entoptic.pipeline import Display, Effects, EyeContext, EyePose, Frame, Glare, Observer, View
from entoptic.pipeline.effects.glare import Mixture, PreparedGlare, scatter
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
    kernel: Mixture,
    observer: Observer,
    aperture: Pose,
    settings: Glare,
    gaze_px: tuple[float, float] | None = None,
) -> np.ndarray:
    """One image (3, y, x) with the glare of a kernel, by an eye that stands like this."""
    image = jnp.array(rgb, jnp.float32)
    x_px, y_px = gaze_px or (view.width_px / 2, view.height_px / 2)
    eye = viewing(Frame(image[None], view), looking_at(view, x_px, y_px, aperture.pupil_diameter_mm), observer)
    eye = dataclasses.replace(eye, aperture=aperture)
    return np.asarray(scatter(image, eye, PreparedGlare(kernel), settings, settings.level), np.float64)
