"""The point-spread function over the angle alone: light per steradian in rings, and encircled light.

Both come from one function of the angle, the light within it, so they agree and lose nothing: of the wave model's core
the rings' means, scaled to each wavelength with its energy, and beyond it CIE 135 integrated over the sphere.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from entoptic.pipeline.effects.glare.models import GRID
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import analytic, diffraction, radial
from entoptic.pipeline.optics.aperture import Pose, pupil_box
from entoptic.services.psf.subject import Angles, Subject

THETA_DEG: Angles = np.concatenate([[0.0], np.geomspace(0.002, 90.0, 240)])
"""Rows of the tables: from half a sample of the pupil plane's function at 575 nm, each 4.6 % further out."""
CPD: Angles = np.geomspace(0.1, 100, 121)
"""Spatial frequencies of the transfer functions, in cycles per degree."""
TABLE_NM = (400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0)
RATIOS_DEG = (0.1, 0.3, 1.0, 2.0, 3.0)
"""Where wave optics is compared with CIE 135."""
NEAR, FINER = 16, 9
"""Within NEAR samples of the axis, where a sample is a good part of the central disc, the core is computed FINER times
as densely. Engineering choice: 9 steps follow the narrowest disc, 2.2 samples to its first dark ring."""
RATIO_RING = 1.05
"""Rings of ± 5 % of their radius, wide enough to average the speckle: 300 samples at 0.1°, 200,000 at 3°."""

Encircled = Callable[[Angles], Angles]
"""Share of all light within angles in degrees from the axis."""


def encircled(subject: Subject, nm: float) -> Encircled:
    """One wavelength's light within an angle, from 0 to all of it at 90°."""
    share = subject.core_share(nm)
    core = _rings(subject.observer, subject.pose) if share else None

    def within(deg: Angles) -> Angles:
        light = np.asarray(radial.encircled(lambda at: subject.formula(at, nm), deg))
        if core is not None:
            samples = np.asarray(deg) / diffraction.bin_deg(nm)
            # All of the core lies within its field.
            light = light + share * core(np.minimum(samples**2, core.x[-1]))
        return light

    return within


def luminous(subject: Subject) -> Encircled:
    """The light's luminance within an angle, all its wavelengths together."""
    nm, weights = subject.luminous()
    parts = [(weight, encircled(subject, float(at))) for weight, at in zip(weights, nm, strict=True) if weight]
    return lambda deg: np.asarray(sum(weight * within(deg) for weight, within in parts))


def density(within: Encircled, low_deg: Angles, high_deg: Angles) -> Angles:
    """Mean of the light per steradian in rings on the sphere."""
    low, high = np.asarray(low_deg, np.float64), np.asarray(high_deg, np.float64)
    # cos a − cos b without cancellation near the axis.
    solid_angle = 4 * math.pi * np.sin(np.radians(high + low) / 2) * np.sin(np.radians(high - low) / 2)
    return (within(high) - within(low)) / solid_angle


def ratios(subject: Subject, other: Subject) -> Angles:
    """Luminous light per steradian of one eye over another's, at RATIOS_DEG."""
    at = np.array(RATIOS_DEG)
    low, high = at / RATIO_RING, at * RATIO_RING
    return density(luminous(subject), low, high) / density(luminous(other), low, high)


def write_tables(subject: Subject, folder: Path) -> None:
    """profile.csv and encircled.csv, a row an angle and a column a wavelength and one for the light; and mtf.csv.

    mtf.csv has the contrast that is left at each spatial frequency by the formulas and by a clear pupil's diffraction.
    """
    functions = {f"{nm:.0f}_nm": encircled(subject, nm) for nm in TABLE_NM}
    functions[f"luminous_{Path(subject.spectrum).stem}"] = luminous(subject)
    edges, angles = _ring_edges(), {"theta_deg": THETA_DEG}
    rings = {name: density(within, *edges) for name, within in functions.items()}
    _write(folder / "profile.csv", angles | rings)
    _write(folder / "encircled.csv", angles | {name: within(THETA_DEG) for name, within in functions.items()})
    age, pupil_diameter_mm = subject.observer.age_years, subject.pose.diameter_m * 1e3
    transfer = {
        "cycles_per_deg": CPD,
        "cie135": analytic.cie135_mtf(CPD, age, subject.pigmentation),
        "ijspeert": analytic.ijspeert_mtf(CPD, pupil_diameter_mm, age, analytic.STRAYLIGHT[subject.observer.iris]),
        "spe": analytic.spe_mtf(CPD, subject.adapted_cd_m2, age),
        "clear_pupil_555_nm": analytic.diffraction_mtf(CPD, pupil_diameter_mm, 555.0),
    }
    _write(folder / "mtf.csv", transfer)


def _write(path: Path, columns: dict[str, Angles]) -> None:
    rows, names = np.stack(list(columns.values()), axis=1), ",".join(columns)
    np.savetxt(path, rows, "%.6g", ",", header=names, comments="", encoding="utf-8")


def _ring_edges() -> tuple[Angles, Angles]:
    """Rings around THETA_DEG that leave nothing out: the first is a disc, the last ends at 90°."""
    between = np.concatenate([[THETA_DEG[1] / 2], np.sqrt(THETA_DEG[1:-1] * THETA_DEG[2:])])
    return np.concatenate([[0.0], between]), np.concatenate([between, [90.0]])


@functools.lru_cache(maxsize=8)
def _rings(observer: Observer, pose: Pose) -> PchipInterpolator:
    """The core's light within a radius, over the radius in samples squared, as which the area goes: 1 within its field.

    A ring's light is its samples' mean times its area, as the count of its samples is up to a quarter off that near
    the axis.
    """
    core = Subject(observer, pose).core()
    middle = len(core) // 2
    far = _ring_means(core, middle + 1)[NEAR + 1 :]
    near = _near_axis(observer, pose) * core[middle, middle]
    fine = _ring_means(near, FINER * NEAR + FINER // 2 + 1)
    edges = np.concatenate([[0.0], (np.arange(len(fine)) + 0.5) / FINER, np.arange(NEAR + 1, middle + 1) + 0.5])
    light = np.cumsum(np.concatenate([fine, far]) * math.pi * np.diff(edges**2))
    return PchipInterpolator(edges**2, np.concatenate([[0.0], light / light[-1]]))


def _ring_means(values: Angles, count: int) -> Angles:
    """Means of the values in rings one sample wide, the first around the axis, which is sample n//2."""
    x = np.arange(len(values)) - len(values) // 2
    ring = np.rint(np.hypot(x[:, None], x[None, :])).astype(np.int64).ravel()
    return np.asarray(np.bincount(ring, values.ravel())[:count] / np.bincount(ring)[:count])


def _near_axis(observer: Observer, pose: Pose) -> Angles:
    """The light in directions FINER times as close, by the sum that the FFT does, relative to the axis.

    Without the fine particles, which have no light there.
    """
    box = pupil_box(observer, pose, GRID, diffraction.WAVELENGTH_NM)
    reach = FINER * NEAR + FINER // 2 + 1
    x, at = np.arange(len(box)) - len(box) // 2, np.arange(-reach, reach + 1) / FINER
    waves = np.exp(-2j * np.pi / GRID * at[:, None] * x[None, :]).astype(np.complex64)
    light = np.abs(waves @ box @ waves.T).astype(np.float64) ** 2
    return np.asarray(light / light[reach, reach])
