"""How far from the sun rounding outshines the dark: a convolution by FFT spreads a share of the brightest light."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import scipy.fft
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.cost.scenes import SUN_DARK_CD_M2, CostScene
from entoptic.pipeline.effects.glare.kernel import Part
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View
from entoptic.pipeline.optics.whole import kernel_radius_px

PLAIN = "a plain float32 FFT of the whole kernel"
RING_DEG = 2.0
"""Width of the rings that errors are told of. Engineering choice: each has some ten of the pixels compared."""


@dataclasses.dataclass(frozen=True)
class SunCorner:
    """The light that an eye scatters around the sun, and errors, over the angle from it."""

    deg: NDArray[np.float64]
    """Middles of rings."""
    truth_cd_m2: NDArray[np.float64]
    """Median luminance on each ring."""
    error_cd_m2: Mapping[str, NDArray[np.float64]]
    """What 95 % of a ring's pixels stay below, for each way to compute the image."""
    dark_cd_m2: float
    """Luminance of the scene beside its sun."""


def sun_corner(
    scene: CostScene,
    part: Part,
    images: Mapping[str, Float[np.ndarray, "3 n"]],
    truth: Float[np.ndarray, "3 n"],
    at: NDArray[np.intp],
) -> SunCorner:
    """Errors of images in cd/m², at pixels (n, 2), by their angle from the scene's brightest pixel.

    One of a part's cells alone is added, float32 against float64: what a plain FFT of it all rounds.
    """
    rgb = scene.frame.rgb_cd_m2[0]
    plain, exact = (
        np.asarray(plain_fft(rgb.astype(dtype), scene.frame.view, part)) for dtype in (jnp.float32, jnp.float64)
    )
    rows, columns = at.T
    differences = {
        PLAIN: (plain - exact)[:, rows, columns],
        **{name: image - truth for name, image in images.items()},
    }
    ring = np.floor(angles_deg(scene.frame.view, _brightest(rgb))[rows, columns] / RING_DEG).astype(int)
    numbers = np.unique(ring)

    def on_rings(values: NDArray[np.float64], percent: float) -> NDArray[np.float64]:
        return np.array([np.percentile(values[ring == number], percent) for number in numbers])

    errors = {name: on_rings(np.abs(_luminance(difference)), 95) for name, difference in differences.items()}
    return SunCorner((numbers + 0.5) * RING_DEG, on_rings(_luminance(truth), 50), errors, SUN_DARK_CD_M2)


def plain_fft(rgb: Float[Array, "3 y x"], view: View, part: Part) -> Float[Array, "3 y x"]:
    """A frame convolved with a part's cells over its pixels, by one FFT in the frame's precision."""
    whole = jnp.asarray(part.cells(view.ppd_centre, kernel_radius_px(view.ppd_centre), 1.0), rgb.dtype)
    radius = whole.shape[2] // 2
    height, width = rgb.shape[1:]
    size = tuple(scipy.fft.next_fast_len(side + 2 * radius, real=True) for side in (height, width))
    spectrum = jnp.einsum("oiyx,iyx->oyx", jnp.fft.rfft2(whole, s=size), jnp.fft.rfft2(rgb, s=size))
    return jnp.fft.irfft2(spectrum, s=size)[:, radius : radius + height, radius : radius + width]


def angles_deg(view: View, pixel: tuple[int, int]) -> Float[np.ndarray, "y x"]:
    """The angle of each pixel's direction from that of one pixel (row, column)."""
    y = np.arange(view.height_px) + 0.5 - view.height_px / 2
    x = np.arange(view.width_px) + 0.5 - view.width_px / 2
    directions = np.stack(np.broadcast_arrays(x[None, :], y[:, None], view.focal_px), axis=2)
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    to_pixel = np.linalg.norm(directions - directions[pixel], axis=2)
    return np.degrees(2 * np.arcsin(np.minimum(to_pixel / 2, 1)))


def _brightest(rgb: Float[Array, "3 y x"]) -> tuple[int, int]:
    luminance = _luminance(np.asarray(rgb))
    row, column = np.unravel_index(int(luminance.argmax()), luminance.shape)
    return int(row), int(column)


def _luminance(rgb: Float[np.ndarray, "3 *n"]) -> Float[np.ndarray, "*n"]:
    return np.einsum("c,c...->...", np.array(LUMINANCE_WEIGHTS), np.asarray(rgb, np.float64))
