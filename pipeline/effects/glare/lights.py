"""Lights of their own, with spectra: apart from the frame's pixels, exact to parts of a pixel, inside the view or not.

Their function is always that of wave optics, whatever the frame's own light uses: a formula knows no spectrum. Far
light of all lights of one spectrum goes to the plane at once, near light is laid down light by light; so a light that
moves by a tenth of a pixel changes smoothly. A light outside the view scatters into it at its true angle.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import defaultdict
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.effects.glare import models
from entoptic.pipeline.effects.glare.kernel import (
    CORE_PER_PX,
    FALLS,
    FINE_PER_PX,
    TURNS,
    Mixture,
    Sampled,
    prepared,
)
from entoptic.pipeline.effects.glare.plane import Plane, b_spline
from entoptic.pipeline.effects.glare.spread import blended, mixed, through
from entoptic.pipeline.effects.glare.stamps import AT_ONCE, REACHES_PX, added, pixel_deg_of, reach_px, windows
from entoptic.pipeline.frame import Light, View
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import light_spectra
from entoptic.pipeline.optics.aperture import Pose

DISC_PX = 2.0
"""Radius up to which a disc is so many points; larger ones are drawn with the frame's pixels. Engineering choice: of a
smaller one no glare shows more than its size."""
SPOTS = (
    (0.0, 0.0),
    *((math.sqrt(2 / 3) * math.cos(k * math.pi / 3), math.sqrt(2 / 3) * math.sin(k * math.pi / 3)) for k in range(6)),
)
"""Points of a disc of radius 1: with them its light spreads as far, in the root mean square, as the disc's."""


@dataclasses.dataclass(frozen=True, eq=False)
class Points:
    """All points of one spectrum."""

    mixture: Mixture
    towards: NDArray[np.float64]
    """Unit vectors (n, 3): right, down, ahead."""
    lux: NDArray[np.float64]


def placed(
    lights: Sequence[Light], view: View, observer: Observer, pose: Pose, ceiling_cd_m2: float | None = None
) -> list[Points]:
    """Lights that are not drawn with the pixels, by their spectra; with a ceiling, only what lies above it."""
    by_spectrum: dict[str, list[tuple[NDArray[np.float64], float]]] = defaultdict(list)
    for light in lights:
        if light.illuminance_lx > 0 and not _is_large(light, view):
            ahead = towards(light)
            lux = light.illuminance_lx
            if ceiling_cd_m2 is not None:
                lux *= _share_above(light, view, ceiling_cd_m2)
            spots = SPOTS if light.radius_deg > 0 else SPOTS[:1]
            for spot in spots:
                by_spectrum[light.spectrum].append((_beside(ahead, spot, light.radius_deg), lux / len(spots)))
    return [
        Points(
            models.wave_mixture(observer, pose, view.ppd_centre, spectrum),
            np.array([direction for direction, _ in points]),
            np.array([lux for _, lux in points]),
        )
        for spectrum, points in by_spectrum.items()
    ]


def towards(light: Light) -> NDArray[np.float64]:
    """Unit vector of a light's direction: right, down, ahead."""
    azimuth, elevation = math.radians(light.azimuth_deg), math.radians(light.elevation_deg)
    return np.array(
        [math.sin(azimuth) * math.cos(elevation), -math.sin(elevation), math.cos(azimuth) * math.cos(elevation)]
    )


def _beside(ahead: NDArray[np.float64], spot: tuple[float, float], radius_deg: float) -> NDArray[np.float64]:
    if spot == (0.0, 0.0) or not radius_deg:
        return ahead
    across = np.cross(ahead, [0.0, 1.0, 0.0] if abs(ahead[1]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    moved = ahead + math.tan(math.radians(radius_deg)) * (spot[0] * across + spot[1] * np.cross(ahead, across))
    return np.asarray(moved / np.linalg.norm(moved))


def _pixel_steradians(ahead: NDArray[np.float64], view: View) -> float:
    return max(float(ahead[2]), 1e-3) ** 3 / view.focal_px**2


def _is_large(light: Light, view: View) -> bool:
    ahead = towards(light)
    return bool(
        ahead[2] > 1e-3 and math.radians(light.radius_deg) > DISC_PX * math.sqrt(_pixel_steradians(ahead, view))
    )


def _share_above(light: Light, view: View, ceiling_cd_m2: float) -> float:
    """Of a light's own, as bright as a pixel with all of it would be."""
    return 1 - ceiling_cd_m2 / max(light.illuminance_lx / _pixel_steradians(towards(light), view), ceiling_cd_m2)


def drawn(rgb: Float[Array, "3 y x"], lights: Sequence[Light], view: View) -> Float[Array, "3 y x"]:
    """A frame with the larger discs among lights of their own drawn into its pixels."""
    for light in lights:
        if light.illuminance_lx > 0 and _is_large(light, view):
            rgb = _with_disc(rgb, light, view)
    return rgb


def _with_disc(rgb: Float[Array, "3 y x"], light: Light, view: View) -> Float[Array, "3 y x"]:
    ahead = towards(light)
    side = math.sqrt(_pixel_steradians(ahead, view))
    reach = math.tan(min(math.radians(light.radius_deg) + 2 * side, 1.5)) / max(ahead[2], 0.05) ** 2 * view.focal_px
    centre = ahead[:2] / ahead[2] * view.focal_px + np.array([view.width_px, view.height_px]) / 2
    left, top = (max(math.floor(at - reach), 0) for at in centre)
    right, bottom = (
        min(math.ceil(at + reach) + 1, size) for at, size in zip(centre, (view.width_px, view.height_px), strict=True)
    )
    if left >= right or top >= bottom:
        return rgb
    u = (np.arange(left, right) + 0.5 - view.width_px / 2) / view.focal_px
    v = (np.arange(top, bottom) + 0.5 - view.height_px / 2)[:, None] / view.focal_px
    secant = np.sqrt(1 + u * u + v * v)
    angle = np.arccos(np.clip((ahead[0] * u + ahead[1] * v + ahead[2]) / secant, -1, 1))
    covered = np.clip((math.radians(light.radius_deg) - angle) / secant**-1.5 * view.focal_px + 0.5, 0, 1)
    cd_m2 = light.illuminance_lx / (2 * math.pi * (1 - math.cos(math.radians(light.radius_deg))))
    disc = colour_of(light.spectrum)[:, None, None] * covered * cd_m2
    return rgb.at[:, top:bottom, left:right].add(jax.device_put(np.float32(disc)))


@functools.lru_cache(maxsize=64)
def colour_of(spectrum: str) -> NDArray[np.float64]:
    """Linear RGB of a spectrum, of luminance 1."""
    return light_spectra.light_weights(spectrum)[1].sum(axis=0)


def on_plane(groups: Sequence[Points], plane: Plane) -> Float[Array, "3 v u"] | None:
    """Far light of the points on the plane, as spread.arrives takes it."""
    each: list[tuple[NDArray[np.float32], list[tuple[Array, Array]], NDArray[np.float32]]] = []
    for points in groups:
        inside = is_on_plane(points, plane)
        if not inside.any():
            continue
        ahead = points.towards[inside]
        row, column, _ = plane.places(ahead[:, 1] / ahead[:, 2], ahead[:, 0] / ahead[:, 2])
        (first_y, weights_y), (first_x, weights_x) = b_spline(row), b_spline(column)
        image = np.zeros((1, plane.height, plane.width), np.float32)
        for down in range(3):
            for right in range(3):
                np.add.at(
                    image[0], (first_y + down, first_x + right), weights_y[down] * weights_x[right] * points.lux[inside]
                )
        made = prepared(points.mixture, plane)
        weights = np.array([weight for _, weight in made], np.float32)
        each.append((image, [(part.high, part.turning) for part, _ in made], weights))
    return _scattered(each, *_plane_arrays(plane)) if each else None


def is_on_plane(points: Points, plane: Plane) -> NDArray[np.bool_]:
    """Which of them the plane holds."""
    ahead = points.towards[:, 2]
    safe = np.where(ahead > 0.01, ahead, 1)
    row, column, _ = plane.places(points.towards[:, 1] / safe, points.towards[:, 0] / safe)
    return (ahead > 0.01) & (row >= 1) & (row < plane.height - 2) & (column >= 1) & (column < plane.width - 2)


@functools.lru_cache(maxsize=8)
def _plane_arrays(plane: Plane) -> tuple[Float[Array, "v u"], tuple[int, int, int, int]]:
    return jax.device_put(np.float32(plane.cosines)), (plane.height, plane.width, plane.fft_height, plane.fft_width)


@functools.partial(jax.jit, static_argnames="size")
def _scattered(
    each: Sequence[tuple[Float[Array, "1 v u"], Sequence[tuple[Array, Array]], Float[Array, "part"]]],
    cosines: Float[Array, "v u"],
    size: tuple[int, int, int, int],
) -> Float[Array, "3 v u"]:
    """Of light of each spectrum, by its own function: they come back from their transforms together."""
    height, width, *fft = size
    turned = cosines ** np.float32(TURNS)
    falling = cosines ** np.float32(-FALLS)
    direct, turning = [], []
    for image, spectra, weights in each:
        light = image * falling
        direct.append(through(blended([part[0] for part in spectra], weights), jnp.fft.rfft2(light, s=fft)))
        turning.append(through(blended([part[1] for part in spectra], weights), jnp.fft.rfft2(light * turned, s=fft)))

    def back(parts: Sequence[Array]) -> Array:
        return jnp.fft.irfft2(functools.reduce(jnp.add, parts), s=fft)[:, :height, :width]

    return back(direct) + turned * back(turning)


def lay_down(image: Float[Array, "3 y x"], groups: Sequence[Points], plane: Plane) -> Float[Array, "3 y x"]:
    """Adds near light of points, and what stays where they are. Consumes `image`."""
    view = plane.view
    for points in groups:
        ahead = np.maximum(points.towards[:, 2], 1e-3)
        place = np.stack(
            [
                points.towards[:, 1] / ahead * view.focal_px + view.height_px / 2,
                points.towards[:, 0] / ahead * view.focal_px + view.width_px / 2,
            ],
            axis=1,
        )
        pixel = np.floor(place)
        reaches = reach_px(plane, pixel[:, 0], pixel[:, 1])
        classes = np.minimum(np.searchsorted(REACHES_PX, reaches), len(REACHES_PX) - 1)
        made = prepared(points.mixture, plane)
        small = mixed([each.mixed for each, _ in made], np.array([weight for _, weight in made], np.float32))
        near = _near([each.sampled for each, _ in made], np.array([weight for _, weight in made], np.float32))
        for k in np.unique(classes):
            reach = REACHES_PX[k]
            close = (classes == k) & (points.towards[:, 2] > 0.01)
            close &= ((pixel > -reach) & (pixel < np.array([view.height_px, view.width_px]) + reach)).all(axis=1)
            mine = np.flatnonzero(close)
            for begin in range(0, len(mine), AT_ONCE):
                some = mine[begin : begin + AT_ONCE]
                at = np.zeros((AT_ONCE, 2), np.float32)
                lux = np.zeros(AT_ONCE, np.float32)
                at[: len(some)], lux[: len(some)] = place[some], points.lux[some]
                image = _points(image, near, pixel_deg_of(plane), small.all_near, at, lux, view, reach)
    return image


@jax.jit
def _near(each: Sequence[Sampled], weights: Float[Array, "part"]) -> Sampled:
    """What is near, without what stays within half a pixel."""

    def without_middle(samples: Array, per_px: int) -> Array:
        cells = slice(samples.shape[-1] // 2 - per_px // 2, samples.shape[-1] // 2 + per_px // 2 + 1)
        return samples.at[:, :, cells, cells].set(0)

    fine, core = (blended([sampled[k] for sampled in each], weights) for k in range(2))
    return Sampled(without_middle(fine, FINE_PER_PX), without_middle(core, CORE_PER_PX))


@functools.partial(jax.jit, static_argnames=("view", "reach"), donate_argnames="image")
def _points(
    image: Float[Array, "3 y x"],
    near: Sampled,
    pixel_deg: float,
    all_near: Float[Array, "3 1"],
    place: Float[Array, "n 2"],
    lux: Float[Array, "n"],
    view: View,
    reach: int,
) -> Float[Array, "3 y x"]:
    pixel = jnp.floor(place).astype(jnp.int32)
    made = windows(near, pixel_deg, pixel, place, view, reach)
    down, right = (
        (place[:, k] - size / 2) / np.float32(view.focal_px) for k, size in enumerate((view.height_px, view.width_px))
    )
    pixels_per_sr = (1 + down * down + right * right) ** 1.5 * np.float32(view.focal_px**2)
    # What stays is shared by the four pixels around, so that it moves smoothly.
    corner = jnp.floor(place - 0.5).astype(jnp.int32)
    beyond = place - 0.5 - corner

    def add(k: Array, image: Array) -> Array:
        around = made.density[k, :, 0] * lux[k]
        stays = (all_near - made.given[k])[:, 0] * lux[k] * pixels_per_sr[k]
        of_rows, of_columns = (jnp.stack([1 - beyond[k, axis], beyond[k, axis]]) for axis in range(2))
        shares = of_rows[:, None] * of_columns
        start = (jnp.int32(0), corner[k, 0] - pixel[k, 0] + reach, corner[k, 1] - pixel[k, 1] + reach)
        was = jax.lax.dynamic_slice(around, start, (3, 2, 2))
        around = jax.lax.dynamic_update_slice(around, was + stays[:, None, None] * shares, start)
        return added(image, around, pixel[k] - reach)

    return jax.lax.fori_loop(0, len(lux), add, image)


def without_glare(image: Float[Array, "3 y x"], lights: Sequence[Light], view: View) -> Float[Array, "3 y x"]:
    """A frame with lights of their own as they are where nothing scatters them, in the pixels that they fall into."""
    image = drawn(jnp.asarray(image), lights, view)
    for light in lights:
        ahead = towards(light)
        if ahead[2] <= 1e-3 or _is_large(light, view) or light.illuminance_lx <= 0:
            continue
        place = (
            np.array([ahead[1], ahead[0]]) / ahead[2] * view.focal_px
            + np.array([view.height_px, view.width_px]) / 2
            - 0.5
        )
        corner = np.floor(place).astype(int)
        beyond = place - corner
        cd_m2 = light.illuminance_lx / _pixel_steradians(ahead, view) * colour_of(light.spectrum)
        for down, right in np.ndindex(2, 2):
            y, x = corner[0] + down, corner[1] + right
            if 0 <= y < view.height_px and 0 <= x < view.width_px:
                share = abs(1 - down - beyond[0]) * abs(1 - right - beyond[1])
                image = image.at[:, y, x].add(jax.device_put(np.float32(cd_m2 * share)))
    return image
