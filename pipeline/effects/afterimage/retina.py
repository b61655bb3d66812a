"""What is bleached of a retina, and how that goes on from frame to frame.

Rushton's kinetics: db/dt = (1 − b)·I/(τ·I0) − b/τ, b the share of a cone's pigment that is bleached, I the light on
the retina in trolands. For a light that stays, b goes exponentially to I/(I + I0), at the rate (1 + I/I0)/τ: stepped by
that solution, it is right for any step. What is kept is b, not the share that is left: near 1 a float32 would lose the
last part of a recovery.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.adaptation import pigments
from entoptic.pipeline.effects.afterimage import geometry
from entoptic.pipeline.effects.afterimage.settings import Afterimage
from entoptic.pipeline.effects.encode import REC709, to_xyz
from entoptic.pipeline.frame import View

TAU_S, HALF_TD = pigments.TAU_S[0], pigments.HALF_TD[0]
"""Return of the cones' pigment, and retinal illuminance that leaves half of it: measured of the L and M cones. The S
cones', which nobody has measured well, are taken as the same."""

CONES_OF_XYZ = ((0.40024, 0.70760, -0.08081), (-0.22630, 1.16532, 0.04570), (0.0, 0.0, 0.91822))
"""L, M and S after Hunt, Pointer and Estévez, each 1 for D65 (Hunt & Pointer 1985; the matrix of von Kries' adaptation
in Fairchild, Color Appearance Models). colour-science has it as "Von Kries", and takes seconds to import."""


@dataclasses.dataclass(frozen=True, eq=False)
class Retina:
    """What one eye's retina remembers."""

    bleached: Float[Array, "3 row column"]
    """Share of the L, M and S cones' pigment that is bleached, 0 to 1, over geometry's map."""
    exposure: float
    """1/(cd/m²), by which the eye now sees light: its own too."""


def rested(settings: Afterimage, exposure: float = 1.0) -> Retina:
    """A retina that has been in the dark for long."""
    count = geometry.cells(settings.cell_deg)
    return Retina(jnp.zeros((3, count, count), jnp.float32), exposure)


def step(
    retina: Retina,
    rgb_cd_m2: Float[Array, "*eye 3 y x"],
    view: View,
    gaze_px: tuple[float, float],
    *,
    image: int = 0,
    pupil_diameter_mm: float,
    openness: float,
    dt_s: float,
    exposure: float,
) -> Retina:
    """The retina after it has seen a frame for `dt_s`; none of its light comes through closed lids (openness 0).

    Of a frame of two images, `image` says which is this eye's. The frame is the scene as it stands before the eye: were
    it the one with glare, what is bleached would depend on what a plan left out.

    Lids that are half down let half of it in. Time that stands still or goes backwards bleaches nothing and brings
    nothing back. `exposure` is what the eye is adapted to now (adaptation.exposure).
    """
    trolands_per_cd_m2 = math.pi / 4 * pupil_diameter_mm**2 * min(max(openness, 0.0), 1.0)
    bleached = _step(
        retina.bleached,
        rgb_cd_m2,
        view,
        image,
        geometry.turn(view, gaze_px),
        np.float32(trolands_per_cd_m2),
        np.float32(max(dt_s, 0.0)),
        cone_matrix().astype(np.float32),
    )
    return Retina(bleached, exposure)


@functools.cache
def cone_matrix() -> NDArray[np.float64]:
    """What L, M and S cones catch of linear Rec.709, each 1 for white at Y = 1: (cone, RGB)."""
    catches = np.array(CONES_OF_XYZ) @ to_xyz(REC709)
    return np.asarray(catches / catches.sum(1, keepdims=True))


@functools.partial(jax.jit, static_argnames=("view", "image"))
def _step(
    bleached: Float[Array, "3 row column"],
    rgb_cd_m2: Float[Array, "*eye 3 y x"],
    view: View,
    image: int,
    turn: Float[Array, "3 3"],
    trolands_per_cd_m2: Float[Array, ""],
    dt_s: Float[Array, ""],
    cones: Float[Array, "3 3"],
) -> Float[Array, "3 row column"]:
    # Here, not before: a slice of a frame would be a copy of it.
    one = rgb_cd_m2[image] if rgb_cd_m2.ndim == 4 else rgb_cd_m2
    catches = jnp.einsum("cj,jyx->cyx", cones, low_resolution(one, view))
    directions = jnp.einsum("ij,jyx->iyx", turn, geometry.cell_directions(bleached.shape[1]))
    row, column, lit = geometry.node_places(directions, view)
    # Glare's spectral colours lie outside Rec.709: a cone may seem to catch less than nothing.
    light = jnp.maximum(geometry.sample(catches, row, column), 0) * lit * trolands_per_cd_m2
    relative = light / np.float32(HALF_TD)
    settled = relative / (1 + relative)
    # In this form a light that stays is met exactly; b·exp(−x) + settled·(1 − exp(−x)) would stop 2e-5 short of it.
    return bleached + (settled - bleached) * -jnp.expm1(-dt_s * (1 + relative) / np.float32(TAU_S))


def low_resolution(rgb: Float[Array, "3 y x"], view: View) -> Float[Array, "3 row column"]:
    """A frame's mean around each of its nodes."""
    for axis, side in zip((1, 2), geometry.node_px(view), strict=True):
        size = rgb.shape[axis]
        whole = size - size % side
        parts = []
        for begin, end in ((0, whole), (whole, size)):
            if begin < end:
                part = jax.lax.slice_in_dim(rgb, begin, end, axis=axis)
                shape = (*part.shape[:axis], -1, min(side, end - begin), *part.shape[axis + 1 :])
                parts.append(part.reshape(shape).mean(axis + 1))
        # Rows first, in a pass of their own: XLA vectorises that one, and the second is small.
        rgb = jax.lax.optimization_barrier(jnp.concatenate(parts, axis))
    return rgb
