"""The vitreous: particles in one rigid sphere that turns a little against the eye (RIT 3.4).

Particles at different depths then move differently past the pupil, those near its back against those near its front;
some leave the pupil, others appear. They are projected along the eye's axis (RIT 5), each with the same shadow.
"""

from __future__ import annotations

import functools
import math

import numpy as np
from jaxtyping import Float

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import coverage
from entoptic.pipeline.optics.lens import diameters_m

RADIUS_M = 8.4e-3
"""Of the sphere: half the way from the lens' back, 7.2 mm behind the cornea, to the retina at 24 mm (Gullstrand)."""
DEPTH_M = 12.0e-3
"""Of its centre behind the pupil, which lies 3.6 mm behind the cornea (Gullstrand). The mean distance of the particles
too, and so that of the one plane that stands for them all where planes are told apart."""
STREAM = 4
"""Which random stream is the vitreous', so that no other part changes it."""


def shade(
    transmittance: Float[np.ndarray, "n n"],
    dx_m: float,
    observer: Observer,
    turned_deg: tuple[float, float] = (0.0, 0.0),
) -> None:
    """Puts the particles before the plane, in place, the sphere's front turned right and up by these angles."""
    stream = observer.seed, STREAM
    x_m, y_m = places_m(stream, observer.vitreous_particles, turned_deg)
    _, deviates = _sphere(stream, observer.vitreous_particles)
    coverage.shade_discs(transmittance, dx_m, x_m, y_m, diameters_m(observer, deviates) / 2)


def places_m(
    stream: tuple[int, ...], before: int, turned_deg: tuple[float, float] = (0.0, 0.0)
) -> tuple[Float[np.ndarray, " particle"], Float[np.ndarray, " particle"]]:
    """Places right of and below the axis of so many particles that, on average, `before` lie before the inscribed disc.

    The sphere is uniformly filled, so turned by any angle it is as good an eye as before.
    """
    x_m, y_m = turn(turned_deg)[:2] @ _sphere(stream, before)[0]
    return x_m, y_m


@functools.lru_cache(maxsize=4)
def _sphere(
    stream: tuple[int, ...], before: int
) -> tuple[Float[np.ndarray, "3 particle"], Float[np.ndarray, " particle"]]:
    """Places in the sphere at rest, right, down and backward, and a normal deviate for each particle."""
    random = np.random.default_rng(stream)
    # The part of the sphere behind the disc is what a cylinder of the disc's width bores out of it.
    bored = 1 - (1 - (coverage.PLANE_M / 2 / RADIUS_M) ** 2) ** 1.5
    count = round(before / bored)
    direction = random.standard_normal((3, count))
    place_m = direction / np.linalg.norm(direction, axis=0) * RADIUS_M * np.cbrt(random.random(count))
    return place_m, random.standard_normal(count)


def turn(turned_deg: tuple[float, float]) -> Float[np.ndarray, "3 3"]:
    """Rotation of (right, down, backward) that takes the front first to the right and then up."""
    right, up = (math.radians(angle) for angle in turned_deg)
    about_vertical = np.array(
        [[math.cos(right), 0, -math.sin(right)], [0, 1, 0], [math.sin(right), 0, math.cos(right)]]
    )
    about_across = np.array([[1, 0, 0], [0, math.cos(up), math.sin(up)], [0, -math.sin(up), math.cos(up)]])
    return np.asarray(about_across @ about_vertical)
