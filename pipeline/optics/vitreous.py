"""The vitreous: particles in one rigid sphere that turns a little against the eye (RIT 3.4).

Particles at different depths then move differently past the pupil, those near its back against those near its front;
some leave the pupil, others appear. They are projected along the eye's axis (RIT 5), each with the same shadow.
"""

from __future__ import annotations

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
    """Puts the particles before the plane, in place, the sphere's front turned right and up by these angles.

    The sphere is uniformly filled, so turned by any angle it is as good an eye as before. At rest, `vitreous_particles`
    of them lie on average before the plane's inscribed disc.
    """
    random = np.random.default_rng([observer.seed, STREAM])
    # The part of the sphere behind the disc is what a cylinder of the disc's width bores out of it.
    bored = 1 - (1 - (coverage.PLANE_M / 2 / RADIUS_M) ** 2) ** 1.5
    count = round(observer.vitreous_particles / bored)
    direction = random.standard_normal((3, count))
    place = direction / np.linalg.norm(direction, axis=0) * RADIUS_M * np.cbrt(random.random(count))
    diameter_m = diameters_m(observer, random.standard_normal(count))
    x, y, _ = turn(turned_deg) @ place
    coverage.shade_discs(transmittance, dx_m, x, y, diameter_m / 2)


def turn(turned_deg: tuple[float, float]) -> Float[np.ndarray, "3 3"]:
    """Rotation of (right, down, backward) that takes the front first to the right and then up."""
    right, up = (math.radians(angle) for angle in turned_deg)
    about_vertical = np.array(
        [[math.cos(right), 0, -math.sin(right)], [0, 1, 0], [math.sin(right), 0, math.cos(right)]]
    )
    about_across = np.array([[1, 0, 0], [0, math.cos(up), math.sin(up)], [0, -math.sin(up), math.cos(up)]])
    return np.asarray(about_across @ about_vertical)
