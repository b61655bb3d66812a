"""One open landscape under five skies, from starlight to the sun's own disc: closed formulas of each pixel's direction.

Sky above, three ridges of hills, a plain of fields with bushes. No pixel is drawn from another, so a frame of any size
shows the same place; texture finer than a pixel fades to its mean.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Frame, View
from entoptic.pipeline.scenes.discs import add_discs

Reals = NDArray[np.float64]

EYE_HEIGHT_M = 1.7
RIDGES = ((6.0, 0.7, 0.55), (3.5, 1.3, 0.3), (1.5, 2.9, 0.1))
"""Farthest first: height in degrees, waves over 60°, and how much of it the air hides."""
FIELD_M, BUSHES = 9.0, 36
GRAIN_CPD = (0.25, 0.4, 0.6, 0.9, 1.4, 2.1, 3.2, 4.8)
"""Frequencies of leaves and stones in cycles per degree; those over GRAIN_SHARE of the display's are left out."""
GRAIN_SHARE, GRAIN = 0.35, 0.12
GRASS, EARTH, LEAVES = (0.10, 0.15, 0.05), (0.20, 0.15, 0.10), (0.04, 0.06, 0.03)
"""Albedos for linear Rec.709."""
SUN_CD_M2, SUN_RADIUS_DEG = 1.6e9, 0.266
"""The sun's disc from the ground (Wyszecki & Stiles 1982; angle: Astronomical Almanac)."""
SUN_AT_DEG = (-14.0, 22.0)
"""Azimuth and elevation. Engineering choice: within any view of 50° or more, above the hills."""
STAR_LX = 2.54e-6
"""Of magnitude 0 (Allen's Astrophysical Quantities)."""
BLUE, WARM, WHITE = (0.72, 1.0, 1.5), (1.6, 0.9, 0.35), (1.0, 1.0, 1.0)


@dataclasses.dataclass(frozen=True)
class Sky:
    """What lights the landscape."""

    zenith_cd_m2: float
    horizon_cd_m2: float
    ground_lx: float
    """On level ground."""
    zenith_colour: tuple[float, float, float] = BLUE
    horizon_colour: tuple[float, float, float] = WHITE
    light_colour: tuple[float, float, float] = WHITE
    stars: int = 0
    sun: bool = False
    """Whether the sun stands in the frame; else it is behind the observer or set."""


STARLIGHT = Sky(1.7e-4, 4e-4, 6e-4, WHITE, stars=150)
"""Moonless, clear, far from towns: 22 mag/arcsec² overhead are 1.7e-4 cd/m²; the ground gets π times that (Allen)."""
MOONLIGHT = Sky(4e-3, 9e-3, 0.2)
"""Full moon, high, behind the observer: 0.2 lx, a sky of 18 mag/arcsec² (Kyba 2017). No lights in the frame."""
DUSK = Sky(0.6, 8.0, 3.4, horizon_colour=WARM)
"""End of civil twilight, the sun 6° below the horizon: 3.4 lx (Seidelmann 1992)."""
SUNNY = Sky(3000.0, 9000.0, 1e5)
"""Clear noon, the sun behind the observer: 1e5 lx (CIE 110)."""
SUN_DISC = dataclasses.replace(SUNNY, sun=True)


def landscape(view: View, sky: Sky) -> Frame:
    """The landscape under a sky, for one eye that looks straight ahead at the horizon."""
    right = np.asarray((np.arange(view.width_px) + 0.5 - view.width_px / 2)[None, :] / view.focal_px, np.float64)
    up = np.asarray((view.height_px / 2 - np.arange(view.height_px) - 0.5)[:, None] / view.focal_px, np.float64)
    azimuth = np.degrees(np.arctan(right))
    elevation = np.degrees(np.arctan2(up, np.sqrt(1 + right * right)))
    above = _sky(elevation, sky)
    light = sky.ground_lx / np.pi * _unit(sky.light_colour)[:, None, None]
    grain = _grain(azimuth, elevation, view)
    air = sky.horizon_cd_m2 * _unit(sky.horizon_colour)[:, None, None]
    image = above
    for k, (high_deg, waves, hidden) in enumerate(RIDGES):
        cover = _step(_ridge(azimuth, high_deg, waves, k) - elevation, view)
        hill = (1 - hidden) * _albedo(LEAVES) * (1 + grain) * light + hidden * 0.5 * air
        image = image + cover * (hill - image)
    ground = _fields(right, up, view) * (1 + grain) * light
    image = image + _step(-0.2 - elevation, view) * (ground - image)
    for at_deg, below_deg, size_deg in _bushes():
        inside = 1 - np.hypot((azimuth - at_deg) / size_deg, (elevation + below_deg) / (0.8 * size_deg))
        image = image + _step(size_deg * inside, view) * (_albedo(LEAVES) * (1 + 2 * grain) * light - image)
    return Frame(_lights(np.maximum(image, 0), view, sky)[None], view)


def _unit(colour: tuple[float, float, float]) -> Reals:
    """At luminance 1."""
    return np.array(colour) / np.dot(LUMINANCE_WEIGHTS, colour)


def _albedo(of: tuple[float, float, float]) -> Reals:
    return np.array(of)[:, None, None]


def _step(over_deg: Reals, view: View) -> Reals:
    """The share of a pixel that lies beyond an edge."""
    return np.clip(over_deg * view.ppd_centre + 0.5, 0, 1)


def _sky(elevation: Reals, sky: Sky) -> Reals:
    """Brighter and paler towards the horizon, over some 20°."""
    low = np.exp(-np.maximum(elevation, 0) / 20)
    zenith, horizon = _unit(sky.zenith_colour), _unit(sky.horizon_colour)
    return np.asarray(
        sky.zenith_cd_m2 * zenith[:, None, None] * (1 - low) + sky.horizon_cd_m2 * horizon[:, None, None] * low
    )


def _ridge(azimuth: Reals, high_deg: float, waves: float, seed: int) -> Reals:
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 4)
    return np.asarray(
        high_deg
        * (0.55 + sum(0.3 / 2**n * np.sin(2 * np.pi * waves * 2**n * azimuth / 60 + phase[n]) for n in range(4)))
    )


def _grain(azimuth: Reals, elevation: Reals, view: View) -> Reals:
    """Waves in random directions, at most GRAIN each way at every frequency."""
    random = np.random.default_rng(3)
    total = np.zeros(np.broadcast_shapes(azimuth.shape, elevation.shape))
    for cpd in GRAIN_CPD:
        turn, phase = random.uniform(0, np.pi), random.uniform(0, 2 * np.pi)
        if cpd < GRAIN_SHARE * view.ppd_centre:
            along = azimuth * np.cos(turn) + elevation * np.sin(turn)
            total += GRAIN / 2 * np.sin(2 * np.pi * cpd * along + phase)
    return total


def _fields(right: Reals, up: Reals, view: View) -> Reals:
    """Albedo of the plain: grass and ploughed earth, striped, and their mean where stripes are below a pixel."""
    ahead_m = EYE_HEIGHT_M / np.maximum(-up, 1e-3)
    across_m = ahead_m * right
    pixel_m = ahead_m**2 / EYE_HEIGHT_M / view.focal_px
    seen = np.exp(-((2 * pixel_m / FIELD_M) ** 2))
    earth = 0.5 + 0.5 * seen * np.tanh(3 * np.sin(np.pi * ahead_m / FIELD_M) * np.cos(np.pi * across_m / FIELD_M))
    return np.asarray(_albedo(GRASS) * (1 - earth) + _albedo(EARTH) * earth)


def _bushes() -> list[tuple[float, float, float]]:
    """Azimuth, degrees below the horizon, radius in degrees: the nearer, the lower and larger."""
    random = np.random.default_rng(11)
    below = np.sort(random.uniform(0.3, 12, BUSHES))
    return list(zip(random.uniform(-65, 65, BUSHES), below - 0.3, 0.25 * below + 0.1, strict=True))


def _lights(image: Reals, view: View, sky: Sky) -> Float[Array, "3 y x"]:
    """With the stars and the sun."""
    drawn = jnp.asarray(image, jnp.float32)
    if sky.stars:
        random = np.random.default_rng(5)
        azimuth, up = random.uniform(-60, 60, sky.stars), random.uniform(9, 55, sky.stars)
        flux = STAR_LX * 10 ** (-0.4 * random.uniform(0.5, 5, sky.stars)) * view.focal_px**2
        at_px = np.array([view.pixel_of(*at) for at in zip(azimuth, up, strict=True)])
        # The light of a disc of half a pixel's radius.
        rgb = np.repeat((flux / (np.pi * 0.25))[:, None], 3, axis=1)
        drawn = _discs(drawn, at_px, np.full(sky.stars, 0.5), rgb)
    if sky.sun:
        radius_px = np.array([SUN_RADIUS_DEG * view.ppd_centre])
        drawn = _discs(drawn, np.array([view.pixel_of(*SUN_AT_DEG)]), radius_px, np.full((1, 3), SUN_CD_M2))
    return drawn


def _discs(image: Float[Array, "3 y x"], at_px: Reals, radius_px: Reals, rgb: Reals) -> Float[Array, "3 y x"]:
    x_px, y_px = at_px.T
    x, y, radius, light = (jnp.asarray(values) for values in (x_px, y_px, radius_px, rgb))
    return add_discs(image, x, y, radius, light, half=int(radius_px.max()) + 5)
