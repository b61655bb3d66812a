"""Light that the eye scatters away from where it belongs.

settings.py   which point-spread function, and how finely it is applied
models.py     the functions, as mixtures of prepared parts
kernel.py     what a part is in a view's plane: far, near, and over a few pixels
plane.py      the plane that light is scattered over, right everywhere in a view
pyramid.py    the frame at lower resolutions, and back
spread.py     all light pooled, scattered over the plane and laid on the pixels
apart.py      which pixels stand out
stamps.py     near light of those, at true angles
lights.py     lights of their own, with spectra
outside.py    those that stand outside the view
around.py     light that a scene knows beyond the view's edges
passing.py    what an eye's motion adds to its resting functions
scatter.py    all of it, for one image
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
from entoptic.pipeline.effects.glare import bounds, lights
from entoptic.pipeline.effects.glare.around import Around, around
from entoptic.pipeline.effects.glare.kernel import Mixture
from entoptic.pipeline.effects.glare.models import GlareModel, mixture
from entoptic.pipeline.effects.glare.scatter import DARKNESS, cropped, glare, mirrored
from entoptic.pipeline.effects.glare.settings import Edge, Glare, GlareLevel
from entoptic.pipeline.effects.tone import full_cd_m2
from entoptic.pipeline.measure import MAX_SOURCES, Measurement
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
    "glare",
    "mixture",
]


@dataclasses.dataclass(frozen=True, eq=False)
class PreparedGlare:
    """What glare works out once a frame and eye."""

    kernel: Mixture
    measured: Measurement
    beyond_cd_m2: NDArray[np.float64]
    """Red, green and blue light beyond the frame's edges."""
    around: Around | None = None
    """What the scene says of the light there more than that."""
    ceiling_cd_m2: float | None = None
    """Where given, only the light above it scatters."""

    @functools.cached_property
    def rings(self) -> bounds.Rings:
        """The light around each tile."""
        return bounds.rings(self.measured, self.beyond_cd_m2, self.ceiling_cd_m2)


class GlareEffect(Effect[Glare, None]):
    """Light that the eye scatters away from where it belongs."""

    name = "glare"
    domain = Domain.SCENE
    Settings = Glare
    seen_by_threshold = True
    costs: Mapping[str, Cost] = {
        "eighth": Cost(12.0, 10.5),
        "quarter": Cost(12.0, 20.8),
        "half": Cost(12.0, 62.8),
        "full": Cost(12.0, 290.0),
    }

    def full_level(self, settings: Glare) -> str:
        return settings.level.value

    def reduced_levels(self, settings: Glare) -> Sequence[str]:
        ladder = [level.value for level in GlareLevel]
        return SKIPPED, *ladder[: ladder.index(settings.level.value)]

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
        beyond = DARKNESS if settings.edge is Edge.DARK else eye.measured.log_average_cd_m2
        if settings.above_display:
            ceiling_cd_m2 = full_cd_m2(eye.adapted_cd_m2, eye.target_cd_m2, eye.effects.tone, eye.display)
            return PreparedGlare(kernel, eye.measured, beyond, ceiling_cd_m2=ceiling_cd_m2)
        if eye.frame.surroundings is None:
            return PreparedGlare(kernel, eye.measured, beyond)
        tile_px = eye.measured.range_cd_m2.tile_px
        more = around(kernel, eye.frame.surroundings, eye.view, tuple(beyond.tolist()), tile_px)
        return PreparedGlare(kernel, eye.measured, beyond, more)

    def prepared(self, eye: EyeContext) -> PreparedGlare:
        """What it worked out for an eye."""
        found: PreparedGlare = eye.prepared[self.name]
        return found

    def cause(self, eyes: Sequence[EyeContext], settings: Glare, level: str) -> tuple[object, ...]:
        return level, settings, *(what for eye in eyes for what in self._cause(eye))

    def _cause(self, eye: EyeContext) -> tuple[object, ...]:
        prepared = self.prepared(eye)
        # Lights have functions of their own, which follow the pose; that of a deformed lens is never the same.
        pose = object() if eye.aperture.lens_m is not None else eye.aperture
        of_lights = (eye.observer, pose) if eye.lights else ()
        return prepared.kernel, eye.view, prepared.ceiling_cd_m2, eye.lights, prepared.around, *of_lights

    def apply(
        self,
        picture: Picture,
        eyes: Sequence[EyeContext],
        settings: Glare,
        level: str,
        tiles: NDArray[np.bool_] | None,
    ) -> Float[Array, "eye 3 y x"]:
        images = [self._glare(picture.image[k], eye, settings.edge, GlareLevel(level)) for k, eye in enumerate(eyes)]
        return _alone(images[0]) if len(images) == 1 else jnp.stack(images)

    def _glare(
        self, image: Float[Array, "3 y x"], eye: EyeContext, edge: Edge, level: GlareLevel
    ) -> Float[Array, "3 y x"]:
        prepared, view = self.prepared(eye), eye.view
        mirrors = edge is Edge.MIRRORED and prepared.around is None
        if mirrors:
            image, view = mirrored(image, view)
        image = glare(
            image,
            view,
            prepared.kernel,
            level,
            prepared.ceiling_cd_m2,
            eye.lights,
            eye.observer,
            eye.aperture,
            prepared.beyond_cd_m2,
            prepared.around,
        )
        return cropped(image, eye.view) if mirrors else image

    def left_out(self, picture: Picture, eyes: Sequence[EyeContext]) -> Float[Array, "eye 3 y x"]:
        if not eyes[0].lights:
            return picture.image
        return jnp.stack([lights.without_glare(picture.image[k], eye.lights, eye.view) for k, eye in enumerate(eyes)])

    def bound(self, ranges: TileRanges, eye: EyeContext, settings: Glare, level: str) -> Change:
        prepared = self.prepared(eye)
        rings = prepared.rings
        most = 0 if prepared.around is None else prepared.around.most
        if level == SKIPPED:
            return np.asarray(bounds.skipped(prepared.kernel, rings) + most)
        differs = bounds.reduced(prepared.kernel, rings, GlareLevel(level), settings.level)
        return np.asarray(differs + OFF_AROUND * most)

    def propagate(self, changes: TileChanges, ranges: TileRanges, eye: EyeContext, settings: Glare) -> Change:
        return bounds.propagate(changes.image, self.prepared(eye).kernel)

    def ranges_after(self, ranges: TileRanges, hidden: Change, eye: EyeContext, settings: Glare) -> Range:
        prepared = self.prepared(eye)
        found = bounds.after(prepared.kernel, prepared.rings, hidden)
        return found if prepared.around is None else found.widened(prepared.around.most)

    def reason(self, eye: EyeContext, settings: Glare) -> str:
        count = len(eye.measured.sources)
        more = " or more" if count == MAX_SOURCES else ""
        lights = (
            f"{count}{more} {'light stands' if count == 1 else 'lights stand'} out" if count else "no light stands out"
        )
        return f"brightest pixel {number(eye.measured.max_cd_m2)} cd/m², {lights}"

    def oracle(self, picture: Picture, eye: EyeContext, settings: Glare) -> NDArray[np.float64]:
        prepared = self.prepared(eye)
        return glare_oracle.of_eye(
            picture.image[0],
            eye,
            prepared.kernel,
            settings.model.value,
            settings.edge is Edge.MIRRORED,
            prepared.beyond_cd_m2,
            prepared.ceiling_cd_m2,
        )

    def truth_of(self, settings: Glare) -> Glare:
        return msgspec.structs.replace(settings, level=GlareLevel.FULL)

    def accuracy(self, settings: Glare) -> float:
        return 0.02 if settings.model is not GlareModel.SPE else 0.2

    def variants(self) -> Mapping[str, Glare]:
        levels = {level.value: Glare(level=level) for level in (Glare().level, *GlareLevel)}
        models = {model.value: Glare(model=model) for model in GlareModel if model is not GlareModel.WAVE}
        edges = {edge.value: Glare(model=GlareModel.CIE, edge=edge) for edge in Edge if edge is not Glare().edge}
        return levels | models | edges


OFF_AROUND = 0.1
"""How far levels differ in light from beyond the edges: they look it up at cells of different sizes."""
GLARE = GlareEffect()


@functools.partial(jax.jit, donate_argnums=0)
def _alone(image: Float[Array, "3 y x"]) -> Float[Array, "1 3 y x"]:
    """One eye's image as a frame, in the same memory."""
    return image[None]
