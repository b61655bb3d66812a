"""What a bleached retina makes of what is seen, and what it shows by itself.

**Less.** A cone with a share p of its pigment catches p of the light. The eye is adapted to what most of its field has
lost, cone by cone; what is seen is the rest: light is multiplied by p over the mean of the field that the frame fills.

**Light of its own.** Threshold in the dark rises tenfold for a third of the pigment (Rushton 1965), as if light lay on
that patch: the light at which the cones' threshold is as high by Weber's law, over the light that a rested eye's own
noise amounts to. A patch of real light that is as bright looks the same if it is held still on the retina too (Barlow
& Sparrock 1964), and what is held still fades. An eye does not see it where it is everywhere, so the mean field's is
taken off.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.effects.afterimage import geometry
from entoptic.pipeline.effects.afterimage.retina import Retina, cone_matrix
from entoptic.pipeline.frame import View
from entoptic.pipeline.threshold import cone_threshold_cd_m2

LOG10_RISE = 3.0
"""By how much the logarithm of the cones' threshold rises where all is bleached (Rushton 1965)."""
WEBER = cone_threshold_cd_m2(1e4) / 1e4
"""What cones tell apart in bright light, as a share of it (Ferwerda)."""
OWN_CD_M2 = cone_threshold_cd_m2(0.0) / WEBER
"""The light that a rested cone's noise amounts to: 3.4 cd/m². By Weber's law it explains its threshold in the dark."""

HELD_STILL = 0.1
"""As bright as it is, light that stays in its place on the retina looks. Engineering choice: with a tenth, what is half
bleached shines in the dark and is dark on a wall of 60 cd/m², as afterimages are; in full it shone on the wall too."""


@dataclasses.dataclass(frozen=True, eq=False)
class Seen:
    """At a frame's nodes, what an eye adds to it and takes from it. Between them it is bilinear."""

    change: Float[Array, "3 row column"]
    """By which share more or less the L, M and S cones see."""
    light: Float[Array, "3 row column"]
    """Linear Rec.709, 0 to 1 = the display's peak: what is seen where nothing is shown."""


@functools.lru_cache(maxsize=8)
def seen(retina: Retina, view: View, gaze_px: tuple[float, float]) -> Seen:
    """What an eye that looks at this pixel of a frame adds to it."""
    return Seen(
        *_seen(
            retina.bleached,
            view,
            geometry.turn(view, gaze_px),
            np.float32(retina.exposure),
            np.linalg.inv(cone_matrix()).astype(np.float32),
        )
    )


@functools.partial(jax.jit, static_argnames="view")
def _seen(
    bleached: Float[Array, "3 row column"],
    view: View,
    turn: Float[Array, "3 3"],
    exposure: Float[Array, ""],
    to_rgb: Float[Array, "3 3"],
) -> tuple[Array, Array]:
    # A rotation's inverse is its transpose.
    directions = jnp.einsum("ji,jyx->iyx", turn, geometry.node_directions(view))
    there = geometry.sample(bleached, *geometry.cell_places(directions, bleached.shape[1]))
    field = there.mean((1, 2), keepdims=True)
    own = jnp.maximum(_own_light_cd_m2(there) - _own_light_cd_m2(field), 0)
    rgb_cd_m2 = jnp.maximum(jnp.einsum("kc,cyx->kyx", to_rgb, own), 0)
    # A wholly bleached field still has some pigment; float32 may say that it has none.
    less = (field - there) / jnp.maximum(1 - field, np.float32(1e-6))
    return less, -jnp.expm1(-rgb_cd_m2 * (exposure * np.float32(HELD_STILL)))


def _own_light_cd_m2(bleached: Float[Array, "..."]) -> Float[Array, "..."]:
    return np.float32(OWN_CD_M2) * jnp.expm1(bleached * np.float32(LOG10_RISE * np.log(10)))
