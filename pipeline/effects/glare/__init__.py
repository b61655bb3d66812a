"""Light that the eye scatters away from where it belongs.

settings.py   which point-spread function, and how it is applied
models.py     the functions, as mixtures of prepared kernels
kernel.py     what a kernel is: what stays, what scatters over pixels, what the veil takes
veil.py       light scattered beyond 4.5–9°: tiles with true angles (veil_tiles.py)
window.py     the kernel for all light in the gaze window or the frame, by FFT (convolve.py)
sources.py    the kernel for the few brightest pixels
light_glare.py  lights that the frame's pixels do not show, with spectra of their own (lights.py)
splat.py      kernels laid down at single pixels
bounds.py     how much all this can change, from the tiles' ranges
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import msgspec
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.effect import SKIPPED, Cost, Domain, Effect, Picture, TileChanges, TileRanges
from entoptic.pipeline.effects.glare import bounds, convolve, light_glare, sources, veil, window
from entoptic.pipeline.effects.glare.kernel import Mixture, least_stays
from entoptic.pipeline.effects.glare.models import GlareModel, mixture
from entoptic.pipeline.effects.glare.settings import Glare, GlareLevel
from entoptic.pipeline.effects.tone import full_cd_m2
from entoptic.pipeline.measure import MAX_SOURCES, luminance
from entoptic.pipeline.oracles import glare as glare_oracle
from entoptic.pipeline.ranges import Change, Range
from entoptic.pipeline.words import number

if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext

__all__ = [
    "GLARE",
    "Glare",
    "GlareEffect",
    "GlareLevel",
    "GlareModel",
    "Mixture",
    "PreparedGlare",
    "mixture",
    "scatter",
]


@dataclasses.dataclass(frozen=True, eq=False)
class PreparedGlare:
    """What glare works out once a frame and eye."""

    kernel: Mixture
    ceiling_cd_m2: float | None = None
    """Where given, only the light above it scatters."""


class GlareEffect(Effect[Glare, None]):
    """Light that the eye scatters away from where it belongs."""

    name = "glare"
    domain = Domain.SCENE
    Settings = Glare
    seen_by_threshold = True
    costs: Mapping[str, Cost] = {
        "veil": Cost(7.3, 7.4),
        "sources": Cost(8.4, 14.1),
        "window": Cost(16.5, 30.5),
        "frame": Cost(9.0, 67.8),
        "reference": Cost(0.0, 60_000.0),
    }

    def full_level(self, settings: Glare) -> str:
        return settings.level.value

    def reduced_levels(self, settings: Glare) -> Sequence[str]:
        match settings.level:
            case GlareLevel.REFERENCE:
                return ()
            case GlareLevel.VEIL:
                return (SKIPPED,)
            case _:
                return SKIPPED, GlareLevel.VEIL.value

    def at_level(self, settings: Glare, level: str) -> Glare:
        return msgspec.structs.replace(settings, level=GlareLevel(level))

    def required(self, eyes: Sequence[EyeContext], settings: Glare) -> str | None:
        lights = len(eyes[0].lights)
        return (
            f"{lights} {'lights of their own are' if lights > 1 else 'light of its own is'} drawn with it"
            if lights
            else None
        )

    def prepare(self, eye: EyeContext, settings: Glare) -> PreparedGlare:
        kernel = mixture(settings.model, eye.observer, eye.aperture, eye.adapted_cd_m2, eye.view.ppd_centre)
        if not settings.above_display:
            return PreparedGlare(kernel)
        return PreparedGlare(kernel, full_cd_m2(eye.adapted_cd_m2, eye.target_cd_m2, eye.effects.tone, eye.display))

    def prepared(self, eye: EyeContext) -> PreparedGlare:
        """What it worked out for an eye."""
        found: PreparedGlare = eye.prepared[self.name]
        return found

    def cause(self, eyes: Sequence[EyeContext], settings: Glare, level: str) -> tuple[object, ...]:
        return level, settings, *(what for eye in eyes for what in self._cause(eye, level))

    def _cause(self, eye: EyeContext, level: str) -> tuple[object, ...]:
        prepared = self.prepared(eye)
        gaze_px = eye.gaze_px if level == GlareLevel.WINDOW else None
        # Lights have kernels of their own, which follow the pose; one with a deformed lens is never the same.
        pose = object() if eye.aperture.lens_m is not None else eye.aperture
        of_lights = (eye.observer, pose) if eye.lights else ()
        return prepared.kernel, gaze_px, eye.view, prepared.ceiling_cd_m2, eye.lights, *of_lights

    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: Glare,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        images = [
            scatter(picture.image[k], eye, self.prepared(eye), settings, GlareLevel(level))
            for k, eye in enumerate(eyes)
        ]
        return _alone(images[0]) if len(images) == 1 else jnp.stack(images)

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: Glare, level: str) -> Change:
        prepared = self.prepared(eye)
        of_kernel = bounds.reduced(prepared.kernel, eye.measured, eye.gaze_px, settings.level, prepared.ceiling_cd_m2)
        if level == GlareLevel.VEIL:
            return of_kernel
        return of_kernel + bounds.veil(prepared.kernel, eye.measured, prepared.ceiling_cd_m2)

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: Glare) -> Change:
        return bounds.propagate(changes.image, self.prepared(eye).kernel)

    def ranges_after(self, ranges: TileRanges, hidden: Change, eye: EyeContext, settings: Glare) -> Range:
        return bounds.after(eye.measured, hidden, least_stays(self.prepared(eye).kernel))

    def reason(self, eye: EyeContext, settings: Glare) -> str:
        count = len(eye.measured.sources)
        more = " or more" if count == MAX_SOURCES else ""
        lights = (
            f"{count}{more} {'light stands' if count == 1 else 'lights stand'} out" if count else "no light stands out"
        )
        return f"brightest pixel {number(eye.measured.max_cd_m2)} cd/m², {lights}"

    def oracle(self, picture: Picture, eye: EyeContext, settings: Glare) -> NDArray[np.float64]:
        prepared = self.prepared(eye)
        return glare_oracle.of_kernel(picture.image[0], eye.view, prepared.kernel, prepared.ceiling_cd_m2)

    def truth_of(self, settings: Glare) -> Glare:
        return msgspec.structs.replace(settings, level=GlareLevel.REFERENCE)

    def accuracy(self, settings: Glare) -> float:
        return {
            GlareLevel.VEIL: 0.6,
            GlareLevel.SOURCES: 0.03,
            GlareLevel.WINDOW: 0.01,
            GlareLevel.FRAME: 1e-3,
            GlareLevel.REFERENCE: 1e-3,
        }[settings.level]

    def variants(self) -> Mapping[str, Glare]:
        levels = {level.value: Glare(level=level) for level in (Glare().level, *GlareLevel) if level != "reference"}
        models = {
            f"{model.value}, frame": Glare(model=model, level=GlareLevel.FRAME)
            for model in GlareModel
            if model is not GlareModel.WAVE
        }
        return levels | models


GLARE = GlareEffect()


def scatter(
    rgb: Float[Array, "3 y x"], eye: EyeContext, prepared: PreparedGlare, settings: Glare, level: GlareLevel
) -> Float[Array, "3 y x"]:
    """One eye's image in cd/m² with glare. A channel may lie below 0, where a colour is not the display's; Y does not.

    Linear in the light, and none is made: what the frame loses leaves it at its edges.
    """
    view, kernel, ceiling = eye.view, prepared.kernel, prepared.ceiling_cd_m2
    if level is GlareLevel.REFERENCE:
        return _with_lights(
            jnp.asarray(glare_oracle.of_eye(rgb, eye, kernel, ceiling, settings.model), jnp.float32), eye, settings
        )
    veiling = rgb if ceiling is None else (rgb * convolve.spill_share(luminance(rgb), ceiling)).astype(jnp.float32)
    result = veil.veil_change(veiling, view, kernel, onto=rgb)
    # The memory of `onto` is taken over; a kernel without a veil left the caller's own.
    onto = None if result is rgb else result
    match level:
        case GlareLevel.SOURCES:
            result, _ = sources.glare_sources(rgb, kernel, eye.measured, ceiling_cd_m2=ceiling, onto=onto)
        case GlareLevel.WINDOW:
            result = window.glare_window(rgb, view, kernel, eye.gaze_px, eye.measured, ceiling_cd_m2=ceiling, onto=onto)
        case GlareLevel.FRAME:
            result = window.glare_frame(rgb, view, kernel, eye.measured, ceiling_cd_m2=ceiling, onto=onto)
    return _with_lights(result, eye, settings)


def _with_lights(rgb: Float[Array, "3 y x"], eye: EyeContext, settings: Glare) -> Float[Array, "3 y x"]:
    if not eye.lights:
        return rgb
    return light_glare.add_lights(rgb, eye.lights, eye.view, eye.observer, eye.aperture, settings.falloff)


@functools.partial(jax.jit, donate_argnums=0)
def _alone(image: Float[Array, "3 y x"]) -> Float[Array, "1 3 y x"]:
    """One eye's image as a frame, in the same memory."""
    return image[None]
