"""Glare in float64, by sums instead of approximations: the truth that the cheaper levels are compared to.

The brightest pixels lay down the kernel one by one, and each pixel gets their veil at its own exact angle from them. So
nothing depends on how well an FFT holds the sun beside starlight. The rest, which is left dimmer and smoother:

- its kernel by an FFT in float64, padded so that nothing wraps round: rounding is 1e-15 of the rest's brightest pixel;
- its veil from some ten thousand boxes of pixels, each at its own centre of light, summed at as many pixels and read
  off between them by a cubic spline. Up to BOXES pixels a side a box is a pixel, so this is exact too. Above, in a view
  of 104°, an even field's veil is within 0.2 %; a frame with more single lights that outshine all else than `brightest`
  needs a larger one, since within 9° of each the spline is off by up to a fifth of what it adds.

Angles come from a table of 0.0002° steps, 5e-5 of a veil.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from entoptic.pipeline.effects.glare import convolve, models, veil
from entoptic.pipeline.effects.glare.kernel import Mixture, Veil
from entoptic.pipeline.effects.glare.models import GlareModel
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, View
from entoptic.pipeline.optics import radial

if TYPE_CHECKING:
    from entoptic.pipeline.eye_context import EyeContext

BRIGHTEST = 256
"""Pixels summed one by one. Engineering choice: more than the sun's disc has at 14 pixels per degree, in 2 s."""
BOXES = 112
"""Along a side at most. Engineering choice: 1° in the middle of a view of 104°, in 5 s."""
TABLE = 1 << 18
"""Entries of the veil's table, even in the sine of half the angle."""
PAIRS_AT_ONCE = 1 << 17
"""Pairs of directions at a time: their working memory, 1 MB an array, stays in the cache."""

Reals = NDArray[np.float64]


def of_eye(rgb: ArrayLike, eye: EyeContext, kernel: Mixture, ceiling_cd_m2: float | None, model: GlareModel) -> Reals:
    """One eye's image in cd/m² with glare; in wave optics with an FFT in float64 for each wavelength: minutes."""
    if model is not GlareModel.WAVE:
        return of_kernel(rgb, eye.view, kernel, ceiling_cd_m2)
    fresh, wide, share = models.reference_kernel(eye.observer, eye.aperture, eye.view.ppd_centre)
    return np.asarray(rgb, np.float64) + reference_change(_light(rgb, ceiling_cd_m2), eye.view, fresh, [(wide, share)])


def of_kernel(rgb: ArrayLike, view: View, kernel: Mixture, ceiling_cd_m2: float | None) -> Reals:
    """One image in cd/m² with the glare of a prepared kernel."""
    return np.asarray(rgb, np.float64) + reference_change(_light(rgb, ceiling_cd_m2), view, *of_mixture(kernel))


def _light(rgb: ArrayLike, ceiling_cd_m2: float | None) -> Reals:
    """What scatters: above a ceiling, what is above it."""
    light = np.asarray(rgb, np.float64)
    if ceiling_cd_m2 is None:
        return light
    luminance = np.einsum("c,cyx->yx", LUMINANCE_WEIGHTS, light)
    return np.asarray(light * convolve.spill_share(luminance, ceiling_cd_m2))


def of_mixture(mixture: Mixture) -> tuple[Reals, list[tuple[Veil, float]]]:
    """A prepared kernel as one array (o, i, k, k), its own pixel included, and its veils with their shares."""
    total: Reals = np.zeros((1, 1, 1, 1))
    for component, weight in mixture:
        part = weight * np.asarray(component.scatters, np.float64)
        middle = part.shape[-1] // 2
        part[:, :, middle, middle] += weight * np.asarray(component.stays, np.float64)
        if len(part) == 1:
            part = np.eye(3)[:, :, None, None] * part[0, 0]
        total = total + part
    return total, list(veil.amounts(mixture).items())


def reference_glare(
    rgb: ArrayLike, view: View, kernel: Reals, veils: Sequence[tuple[Veil, float]], brightest: int = BRIGHTEST
) -> Reals:
    """A frame in cd/m², (3, y, x), with glare of all its light; as reference_change."""
    return np.asarray(rgb, np.float64) + reference_change(rgb, view, kernel, veils, brightest)


def reference_change(
    light: ArrayLike, view: View, kernel: Reals, veils: Sequence[tuple[Veil, float]], brightest: int = BRIGHTEST
) -> Reals:
    """What glare of a frame's light changes, in cd/m² for light in cd/m², (3, y, x).

    `kernel` is all that a point's light does up to where the veil takes over, its own pixel included: (k, k) if it is
    alike for all channels or (o, i, k, k) from channel i to channel o, k odd. Each veil comes with the share of all
    light that it takes. What the kernel's sum lacks of the rest is put right in its central pixel.
    """
    values = np.asarray(light, np.float64)
    matrices = kernel if kernel.ndim == 4 else kernel[None, None]
    taken = sum(share for _, share in veils)
    whole = matrices.copy()
    middle = whole.shape[-1] // 2
    whole[:, :, middle, middle] += np.eye(len(whole)) * (1 - taken) - whole.sum(axis=(2, 3))
    if len(whole) == 1:
        whole = np.eye(3)[:, :, None, None] * whole[0, 0]
    bright = _brightest(values, brightest)
    rest = values.copy()
    rest[:, bright[0], bright[1]] = 0
    change = _convolved(rest, whole) - values
    for y, x in zip(*bright, strict=True):
        _lay_down(change, values[:, y, x], whole, int(y), int(x))
    if taken > 0:
        density = _density(veils)
        change += _exact_veil(values, view, bright, density) + _veil_of_rest(rest, view, density)
    return change


def _brightest(light: Reals, count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the brightest pixels that are not black."""
    luminance = np.einsum("c,cyx->yx", LUMINANCE_WEIGHTS, light).ravel()
    first = np.argsort(-luminance, kind="stable")[:count]
    rows, columns = np.unravel_index(first[luminance[first] > 0], light.shape[1:])
    return rows, columns


def _convolved(light: Reals, kernel: Reals) -> Reals:
    _, height, width = light.shape
    middle = kernel.shape[-1] // 2
    up, left = min(middle, height - 1), min(middle, width - 1)
    reaching = kernel[..., middle - up : middle + up + 1, middle - left : middle + left + 1]
    # Imported here, since it takes a second and only this level needs it.
    from scipy.signal import fftconvolve

    result = np.zeros_like(light)
    for o, i in np.ndindex(3, 3):
        if light[i].any() and reaching[o, i].any():
            full = fftconvolve(light[i], reaching[o, i])
            result[o] += full[up : up + height, left : left + width]
    return result


def _lay_down(image: Reals, light: Reals, kernel: Reals, y: int, x: int) -> None:
    _, height, width = image.shape
    middle = kernel.shape[-1] // 2
    top, bottom = max(y - middle, 0), min(y + middle + 1, height)
    left, right = max(x - middle, 0), min(x + middle + 1, width)
    around = kernel[:, :, top - y + middle : bottom - y + middle, left - x + middle : right - x + middle]
    image[:, top:bottom, left:right] += np.einsum("oijk,i->ojk", around, light)


def _density(veils: Sequence[tuple[Veil, float]]) -> Callable[[Reals], Reals]:
    """All veils together per steradian, of the cosine of an angle; each takes the share that it comes with."""
    deg = 2 * np.degrees(np.arcsin(np.linspace(0, 1, TABLE + 1)))
    inside = (deg > 0) & (deg <= radial.EDGE_DEG)
    table = np.zeros(TABLE + 1)
    for wide, share in veils:
        table[inside] += share / radial.hemisphere_volume(wide.density) * wide.density(deg[inside])

    def of_cosine(cosine: Reals) -> Reals:
        nearest = np.sqrt(np.maximum(0.5 - 0.5 * cosine, 0)) * TABLE + 0.5
        return np.asarray(table.take(nearest.astype(np.int32), mode="clip"))

    return of_cosine


def _tangents(view: View) -> tuple[Reals, Reals]:
    """Of each row and each column, downwards and to the right."""

    def along(size: int) -> Reals:
        return np.asarray((np.arange(size) + 0.5 - size / 2) / view.focal_px)

    return along(view.height_px), along(view.width_px)


def _directions(view: View) -> Reals:
    """Unit vectors of all pixels, (y, x, 3)."""
    v, u = np.meshgrid(*_tangents(view), indexing="ij")
    towards = np.stack([u, v, np.ones_like(u)], axis=-1)
    return np.asarray(towards / np.linalg.norm(towards, axis=-1, keepdims=True))


def pixel_solid_angles(view: View) -> Reals:
    """Solid angle of each pixel in sr: the light's cone through a rectangle, by the areas of its four corners."""
    edges = [np.arange(size + 1) - size / 2 for size in (view.height_px, view.width_px)]
    v, u = np.meshgrid(*edges, indexing="ij")
    corner = np.arctan2(u * v, view.focal_px * np.sqrt(view.focal_px**2 + u * u + v * v))
    return np.asarray(np.diff(np.diff(corner, axis=0), axis=1))


def _exact_veil(
    light: Reals, view: View, at: tuple[NDArray[np.intp], NDArray[np.intp]], density: Callable[[Reals], Reals]
) -> Reals:
    """What each pixel gets from single ones."""
    directions, solid_angles = _directions(view), pixel_solid_angles(view)
    result = np.zeros_like(light)
    for y, x in zip(*at, strict=True):
        arrives = density(directions @ directions[y, x]) * solid_angles[y, x]
        result += light[:, y, x, None, None] * arrives
    return result


def _veil_of_rest(light: Reals, view: View, density: Callable[[Reals], Reals]) -> Reals:
    if not light.any():
        return np.zeros_like(light)
    side = math.ceil(max(view.height_px, view.width_px) / BOXES)
    directions = _directions(view)
    flux = light * pixel_solid_angles(view)
    boxes = _boxes(flux, side)
    weight = np.einsum("c,cyx->yx", LUMINANCE_WEIGHTS, flux)
    centres = _boxes(directions.transpose(2, 0, 1) * weight, side)
    lit = boxes.sum(axis=0) > 0
    towards = centres[:, lit]
    towards = (towards / np.linalg.norm(towards, axis=0)).T
    rows, columns = (_sampled(size, side) for size in (view.height_px, view.width_px))
    receivers = directions[np.ix_(rows, columns)].reshape(-1, 3)
    arrives = np.empty((len(receivers), 3))
    step = max(PAIRS_AT_ONCE // len(towards), 1)
    for start in range(0, len(receivers), step):
        some = slice(start, start + step)
        arrives[some] = density(receivers[some] @ towards.T) @ boxes[:, lit].T
    low = arrives.T.reshape(3, len(rows), len(columns))
    return low if side == 1 else np.stack([_read_off(channel, rows, columns, view) for channel in low])


def _boxes(values: Reals, side: int) -> Reals:
    """Sums of boxes of pixels; those at the ends may be smaller."""
    by_row = np.add.reduceat(values, np.arange(0, values.shape[1], side), axis=1)
    return np.asarray(np.add.reduceat(by_row, np.arange(0, values.shape[2], side), axis=2))


def _sampled(size: int, side: int) -> NDArray[np.intp]:
    """Pixels from end to end, one a box."""
    return np.unique(np.rint(np.linspace(0, size - 1, -(-size // side) + 1)).astype(np.intp))


def _read_off(low: Reals, rows: NDArray[np.intp], columns: NDArray[np.intp], view: View) -> Reals:
    from scipy.interpolate import RectBivariateSpline

    if len(rows) == 1:
        rows, low = np.array([0, 1]), np.repeat(low, 2, axis=0)
    if len(columns) == 1:
        columns, low = np.array([0, 1]), np.repeat(low, 2, axis=1)
    spline = RectBivariateSpline(rows, columns, low, kx=min(3, len(rows) - 1), ky=min(3, len(columns) - 1))
    return np.asarray(spline(np.arange(view.height_px), np.arange(view.width_px)))
