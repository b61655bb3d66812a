"""Light that the eye scatters away from where it belongs.

settings.py   which point-spread function, and how it is applied
models.py     the functions, as mixtures of prepared kernels
kernel.py     what a kernel is: what stays, what scatters over pixels, what the veil takes
veil.py       light scattered beyond 4.5–9°: tiles with true angles (veil_tiles.py)
window.py     the kernel for all light in the gaze window or the frame, by FFT (convolve.py)
sources.py    the kernel for the few brightest pixels
light_glare.py  lights that the frame's pixels do not show, with spectra of their own (lights.py)
stamp.py      kernels laid down at single pixels
reference.py  the truth that the others are compared to
changes.py    how much all this can change, from the tiles' ranges
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from entoptic.pipeline.effects.glare import convolve, light_glare, reference, sources, veil, window
from entoptic.pipeline.effects.glare.kernel import Mixture
from entoptic.pipeline.effects.glare.models import GlareModel, mixture
from entoptic.pipeline.effects.glare.settings import Glare, GlareLevel
from entoptic.pipeline.frame import Light, View
from entoptic.pipeline.measure import Measurement, luminance
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose

__all__ = ["Glare", "GlareLevel", "GlareModel", "Mixture", "Sight", "mixture", "scatter"]


@dataclasses.dataclass(frozen=True)
class Sight:
    """One eye before one image: all that glare needs to know of it."""

    view: View
    measured: Measurement
    gaze_px: tuple[float, float]
    """(x, y) from the upper left corner; may lie outside the frame."""
    kernel: Mixture
    observer: Observer
    pose: Pose
    adapted_cd_m2: float
    ceiling_cd_m2: float | None = None
    """Where given, only the light above it scatters."""
    lights: tuple[Light, ...] = ()

    def cause(self, settings: Glare) -> tuple[object, ...]:
        """All that decides what glare makes of an image, to be compared: of its kernel the identity."""
        gaze_px = self.gaze_px if settings.level is GlareLevel.WINDOW else None
        # Lights have kernels of their own, which follow the pose; one with a deformed lens is never the same.
        pose = object() if self.pose.lens_m is not None else self.pose
        eye = (self.observer, pose) if self.lights else ()
        return self.kernel, gaze_px, self.view, self.ceiling_cd_m2, self.lights, *eye


def scatter(rgb: Float[Array, "3 y x"], sight: Sight, settings: Glare) -> Float[Array, "3 y x"]:
    """One eye's image in cd/m² with glare. A channel may lie below 0, where a colour is not the display's; Y does not.

    Linear in the light, and none is made: what the frame loses leaves it at its edges.
    """
    view, kernel, ceiling = sight.view, sight.kernel, sight.ceiling_cd_m2
    if settings.level is GlareLevel.REFERENCE:
        result = jnp.asarray(reference.of_sight(rgb, sight, settings.model), jnp.float32)
        return _with_lights(result, sight, settings)
    veiling = rgb if ceiling is None else (rgb * convolve.spill_share(luminance(rgb), ceiling)).astype(jnp.float32)
    result = veil.veil_change(veiling, view, kernel, onto=rgb)
    # The memory of `onto` is taken over; a kernel without a veil left the caller's own.
    onto = None if result is rgb else result
    match settings.level:
        case GlareLevel.SOURCES:
            result, _ = sources.glare_sources(rgb, kernel, sight.measured, ceiling_cd_m2=ceiling, onto=onto)
        case GlareLevel.WINDOW:
            result = window.glare_window(
                rgb, view, kernel, sight.gaze_px, sight.measured, ceiling_cd_m2=ceiling, onto=onto
            )
        case GlareLevel.FRAME:
            result = window.glare_frame(rgb, view, kernel, sight.measured, ceiling_cd_m2=ceiling, onto=onto)
    return _with_lights(result, sight, settings)


def _with_lights(rgb: Float[Array, "3 y x"], sight: Sight, settings: Glare) -> Float[Array, "3 y x"]:
    if not sight.lights:
        return rgb
    return light_glare.add_lights(rgb, sight.lights, sight.view, sight.observer, sight.pose, settings.falloff)
