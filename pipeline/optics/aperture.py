"""The pupil plane: what of the light passes where, and how its phase is turned.

The plane is a square of `PLANE_M`, sampled n × n; sample i lies at (i − n//2)·dx, so the origin is a sample. Columns
run to the right and rows downward, as their owner sees out of the eye. Each structure is a file of its own with its own
statistics and random stream: switching one off leaves the others as they are. Overlaps multiply transmittances.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import OpticsError, cornea, coverage, focus, lens, lids, vitreous

PLANE_M = coverage.PLANE_M
"""Side of the pupil plane: the widest pupil."""
PUPIL_RANGE_MM = (2.0, 8.0)
"""What a pupil is clamped to (LUI 5.2.1 ii)."""
BLOCKED_LIMIT = 0.5
"""Share of the plane that particles may block. Engineering choice: the average eye has 4 %; beyond a half, a cataract,
single scattering is no model any more, and some pupil would pass nothing."""


@dataclass(frozen=True)
class Pose:
    """How everything in the eye stands at one moment."""

    pupil_diameter_mm: float
    """Diameter of the pupil; clamped to `PUPIL_RANGE_MM`."""
    defocus_d: float = 0.0
    """Error of accommodation in dioptres: a phase, and so another one at each wavelength."""
    openness: float = 1.0
    """Of the lids, 0 closed … 1 clear of any pupil."""
    lashes: bool = False
    """Whether lashes hang before the pupil."""
    vitreous_deg: tuple[float, float] = (0.0, 0.0)
    """How far the front of the vitreous is turned against the eye, to the right and up."""
    lens_m: Float[np.ndarray, "17 17"] | None = None
    """Radial displacement within the lens in metres: rows depth over its thickness, columns radius from 0 to all."""

    @property
    def diameter_m(self) -> float:
        """Diameter of the pupil within `PUPIL_RANGE_MM`, in metres."""
        return legal_pupil_diameter_mm(self.pupil_diameter_mm) * 1e-3

    @property
    def parts_at_rest(self) -> bool:
        """Whether lens and vitreous are at rest, whatever lids and focus do."""
        return self.lens_m is None and self.vitreous_deg == (0.0, 0.0)


def legal_pupil_diameter_mm(pupil_diameter_mm: float) -> float:
    """A diameter clamped to `PUPIL_RANGE_MM`; NaN counts as the narrowest."""
    low, high = PUPIL_RANGE_MM
    return min(max(low, pupil_diameter_mm), high)


def pupil_plane(observer: Observer, pose: Pose, n: int = 2048) -> Complex[np.ndarray, "n n"]:
    """Complex transmittance of everything in this observer's eye at this moment, in focus; complex64.

    Raises OpticsError as `pupil_box` does.
    """
    return placed(pupil_box(observer, pose, n), n)


def placed(box: Complex[np.ndarray, "m m"], n: int) -> Complex[np.ndarray, "n n"]:
    """The plane whose middle is the box, m odd; dark around it."""
    plane = np.zeros((n, n), box.dtype)
    part = _middle(n, len(box))
    plane[part, part] = box
    return plane


def pupil_box(
    observer: Observer, pose: Pose, n: int, wavelength_nm: float | None = None, *, vitreous_apart: bool = False
) -> Complex[np.ndarray, "m m"]:
    """Of that plane the middle, which is all that the pupil shows: m is odd, and the axis its middle sample.

    With the phase that the eye's defocus has at a wavelength; without one, as if it were in focus. Parts that do not
    move are drawn once. The vitreous lies in the same plane as all else (RIT 5) unless it is left to `later_planes`.
    Raises OpticsError if the grid is too coarse for lens fibres or the phase, or the particles block too much.
    """
    shown = opening(observer, pose, n)
    if pose.parts_at_rest and not vitreous_apart:
        return _product(_resting(_anatomy(observer), n), shown, pose, n, wavelength_nm)
    lens.shade(shown, PLANE_M / n, observer, pose.lens_m)
    if not vitreous_apart:
        vitreous.shade(shown, PLANE_M / n, observer, pose.vitreous_deg)
    return _product(_still(_anatomy(observer), n), shown, pose, n, wavelength_nm)


def later_planes(observer: Observer, pose: Pose, n: int) -> tuple[tuple[Float[np.ndarray, "n n"], float]]:
    """What lies behind the pupil with its distance in metres, for exact propagation.

    The vitreous' particles, all at the depth of its centre. In coordinates of the pupil, float32; their shadows are
    those that fall along the axis onto the pupil (RIT 5), in both models: in place, where the beam has narrowed to
    0.41, they would be as much narrower.
    """
    later = np.ones((n, n), np.float32)
    vitreous.shade(later, PLANE_M / n, observer, pose.vitreous_deg)
    return ((later, vitreous.DEPTH_M),)


def blocked_share(observer: Observer) -> float:
    """Share of the plane that all particles block on average, before overlaps."""
    widening = lens.mean_square_of_spread(observer.particle_spread)
    particles = (observer.particles + observer.vitreous_particles) * (observer.particle_mm * 1e-3) ** 2 * widening
    return float((particles + observer.cornea_cells * cornea.CELL_M**2) / PLANE_M**2)


def opening(observer: Observer, pose: Pose, n: int) -> Float[np.ndarray, "m m"]:
    """The pupil behind the lids, on the part of the grid around the origin that it reaches."""
    dx_m = PLANE_M / n
    shown = coverage.disc(pose.diameter_m, 2 * math.ceil(pose.diameter_m / 2 / dx_m) + 1, dx_m)
    if pose.openness < 1:
        lids.shade(shown, dx_m, pose.openness, pose.diameter_m)
    if pose.lashes:
        lids.shade_lashes(shown, dx_m, observer, pose.openness, pose.diameter_m)
    return shown


def _anatomy(observer: Observer) -> Observer:
    """The observer as far as these planes know them: the same planes serve at any age and focus."""
    return Observer(
        particles=observer.particles,
        particle_mm=observer.particle_mm,
        particle_spread=observer.particle_spread,
        gratings=observer.gratings,
        cornea_cells=observer.cornea_cells,
        vitreous_particles=observer.vitreous_particles,
        seed=observer.seed,
    )


@functools.lru_cache(maxsize=4)
def _still(observer: Observer, n: int) -> Complex[np.ndarray, "n n"]:
    """What never moves: cornea and fibres."""
    if (blocked := blocked_share(observer)) > BLOCKED_LIMIT:
        raise OpticsError(
            f"the particles of this observer block {blocked:.0%} of the pupil plane, which leaves no image: "
            f"fewer or smaller ones, up to {BLOCKED_LIMIT:.0%} in all"
        )
    clear = np.ones((n, n), np.float32)
    cornea.shade(clear, PLANE_M / n, observer)
    return clear * (1 + np.complex64(1j) * lens.fibres(observer, n))


@functools.lru_cache(maxsize=4)
def _resting(observer: Observer, n: int) -> Complex[np.ndarray, "n n"]:
    """Everything in an eye at rest but its pupil."""
    still = _still(observer, n)
    clear = np.ones((n, n), np.float32)
    lens.shade(clear, PLANE_M / n, observer)
    vitreous.shade(clear, PLANE_M / n, observer)
    return still * clear


def _product(
    still: Complex[np.ndarray, "n n"],
    shown: Float[np.ndarray, "m m"],
    pose: Pose,
    n: int,
    wavelength_nm: float | None,
) -> Complex[np.ndarray, "m m"]:
    """All that is shown, with its phase."""
    part = _middle(n, len(shown))
    box = np.asarray(still[part, part] * shown)
    if pose.defocus_d and wavelength_nm is not None:
        focus.turn(box, n, pose.defocus_d, pose.diameter_m, wavelength_nm)
    return box


def _middle(n: int, m: int) -> slice:
    """Where the middle m samples of n lie, m odd."""
    return slice(n // 2 - m // 2, n // 2 + m // 2 + 1)
