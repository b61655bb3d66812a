"""The eye's point-spread function as it is applied: a kernel over display pixels and a veil beyond it.

A kernel is a sum of prepared components with weights: of two pupils on either side of the one that is seen with, or of
the terms of a formula whose weights follow adaptation. So neither a pupil in motion nor an eye that adapts needs a new
kernel for each frame.

Of a component's central pixel, what stands above its neighbours is light that stays where it belongs: it multiplies the
frame and is kept out of every convolution, whose rounding would spread a part of every light.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.optics import whole

Formula = Callable[..., NDArray[np.float64]]
"""One of analytic.py's densities: of the angle in degrees and its parameters."""


@dataclasses.dataclass(frozen=True)
class Veil:
    """Light that an analytic function scatters further than a kernel reaches; it has the colour of its source."""

    function: Formula
    parameters: tuple[float, ...] = ()

    def density(self, deg: NDArray[np.float64]) -> NDArray[np.float64]:
        """Per steradian, at an angle."""
        return self.function(deg, *self.parameters) * whole.veil_part(deg)


@dataclasses.dataclass(frozen=True, eq=False)
class Component:
    """One prepared part of a kernel; from each channel `i` to each channel `o`, or 1×1 where all channels are alike."""

    stays: Float[Array, "o i"]
    """Light that stays in its pixel."""
    scatters: Float[Array, "o i j k"]
    """Light that the pixels around get. A spectral colour lies outside Rec.709, so a channel may lose by another's
    light; the luminance of each pixel is positive."""
    veil: Veil | None
    veil_share: float
    """Light that the veil takes. The sum of all three over pixels is the identity."""
    transforms: dict[tuple[object, ...], Array] = dataclasses.field(default_factory=dict, repr=False)
    """Of `scatters`, as they were asked for last: they go when the component goes."""
    _rings: dict[tuple[int, ...], NDArray[np.float64]] = dataclasses.field(default_factory=dict, repr=False)

    @functools.cached_property
    def keeps(self) -> NDArray[np.float64]:
        """The light that is left where it is by all that scatters over pixels: what stays and the veil's, 3×3."""
        alike = np.eye(3) if self.stays.shape == (1, 1) else 1
        return np.eye(3) * self.veil_share + np.asarray(self.stays, np.float64) * alike

    @functools.cached_property
    def least_stays(self) -> float:
        """Least share of a point's luminance that stays in its pixel."""
        scatters, stays = np.asarray(self.scatters, np.float64), np.asarray(self.stays, np.float64)
        middle = scatters[:, :, scatters.shape[2] // 2, scatters.shape[3] // 2] + stays
        if len(middle) > 1:
            # The luminance that each channel's light makes, as a share of its own.
            to_luminance = np.array(LUMINANCE_WEIGHTS)
            return float((to_luminance @ middle / to_luminance).min())
        return float(middle.min())

    def rings(self, edges_px: tuple[int, ...]) -> NDArray[np.float64]:
        """What is scattered further than one edge and no further than the next, along either axis: (ring, 4, 3).

        To red, green, blue and luminance from a unit of each channel, all counted as positive.
        """
        if edges_px not in self._rings:
            to, away_px = self._strewn
            ring = np.searchsorted(edges_px, away_px.max(axis=0))
            self._rings[edges_px] = np.stack([to[:, :, ring == k].sum(axis=-1) for k in range(len(edges_px))])
        return self._rings[edges_px]

    @functools.cached_property
    def moment_px(self) -> NDArray[np.float64]:
        """The same, each share times how far it goes: (4, 3)."""
        to, away_px = self._strewn
        return np.asarray((to * np.hypot(*away_px)).sum(axis=(2, 3)))

    @functools.cached_property
    def gain(self) -> NDArray[np.float64]:
        """(4, 3): what arrives at most in red, green, blue and luminance of a unit of each channel all over."""
        scatters = np.asarray(self.scatters, np.float64)
        if len(scatters) == 1:
            scatters = np.eye(3)[:, :, None, None] * scatters
        both = [
            np.concatenate([part, np.tensordot(LUMINANCE_WEIGHTS, part, 1)[None]]) for part in (scatters, self.keeps)
        ]
        return np.asarray(np.abs(both[0]).sum(axis=(2, 3)) + np.abs(both[1]))

    @property
    def _strewn(self) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Magnitudes (4, 3, j, k), and how far down and right each goes. What lands where it comes from is 0."""
        scatters = np.asarray(self.scatters, np.float64)
        if len(scatters) == 1:
            scatters = np.eye(3)[:, :, None, None] * scatters
        to = np.concatenate([scatters, np.einsum("o,oijk->ijk", np.array(LUMINANCE_WEIGHTS), scatters)[None]])
        away_px = np.abs(np.indices(to.shape[2:]) - np.array(to.shape[2:])[:, None, None] // 2)
        return np.abs(to) * (away_px.max(axis=0) > 0), away_px


Mixture = tuple[tuple[Component, float], ...]
"""A kernel: components and their weights, which add up to 1."""


def least_stays(mixture: Mixture) -> float:
    """Least share of a point's luminance that stays in its pixel."""
    return sum(weight * component.least_stays for component, weight in mixture)


def component(kernel: NDArray[np.float64], veil: Veil | None, veil_share: float) -> Component:
    """A component from the light in each pixel, (o, i, k, k) with odd k, or (k, k) where all channels are alike.

    What the kernel's sum lacks of 1, or has above it on a flat plane, is put right in its central pixel.
    """
    full = kernel if kernel.ndim == 4 else kernel[None, None]
    o = full.shape[0]
    y, x = full.shape[2] // 2, full.shape[3] // 2
    to_luminance = np.array(LUMINANCE_WEIGHTS if o == 3 else (1.0,))
    luminance = np.einsum("o,oijk->ijk", to_luminance, full)
    around = luminance[:, max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].reshape(len(luminance), -1).copy()
    around[:, around.shape[1] // 2] = 0
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = np.where(luminance[:, y, x] > 0, around.max(axis=1) / luminance[:, y, x], 0)
    scatters = full.copy()
    scatters[:, :, y, x] *= np.minimum(spread, 1)
    stays = np.eye(o) * (1 - veil_share) - scatters.sum(axis=(2, 3))
    return Component(jnp.asarray(stays, jnp.float32), jnp.asarray(scatters, jnp.float32), veil, veil_share)
