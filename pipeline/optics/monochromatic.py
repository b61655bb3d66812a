"""One eye's point-spread function at one wavelength: its pupil plane, and the particles too fine for it."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Complex, Float

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import aperture, diffraction, fine_scatter
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.diffraction import WAVELENGTH_NM


def monochromatic(
    observer: Observer,
    pose: Pose,
    n: int = 2048,
    *,
    size: int | None = None,
    wavelength_nm: float = WAVELENGTH_NM,
    vitreous_apart: bool = False,
    double: bool = False,
) -> Float[np.ndarray, "size size"]:
    """Of an n × n plane, whose lit part is transformed at `size` × `size` samples, by default n × n.

    The samples are as wide as diffraction.bin_deg, times n/size. float32, or with `double` in float64. With
    `vitreous_apart`, which needs all n × n samples, the vitreous' structures stand where they are in the eye.
    Raises OpticsError as aperture.pupil_box does.
    """
    number = np.complex128 if double else np.complex64
    size = n if size is None else size

    def of_points() -> tuple[Complex[np.ndarray, "size size"], float]:
        """The fine particles' field before it is weighted by the angle, and their power."""
        points = fine_scatter.points(observer, pose, n, wavelength_nm).astype(number, copy=False)
        placed = aperture.placed(points, n) if vitreous_apart else points
        return diffraction.field_of(placed, size), fine_scatter.power(points)

    # Neither field needs the other, and each keeps one core busy.
    with ThreadPoolExecutor(1) as beside:
        fine = beside.submit(of_points)
        box = aperture.pupil_box(observer, pose, n, wavelength_nm, vitreous_apart=vitreous_apart)
        box = box.astype(number, copy=False)
        if vitreous_apart:
            later = aperture.later_planes(observer, pose, n)
            box = diffraction.through_planes(aperture.placed(box, n), later, wavelength_nm)
        field = diffraction.field_of(box, size)
        scattered, power = fine.result()
    weight, share = fine_scatter.weighting(n, size, observer)
    if power and share:
        # Part by part: a complex array times a real one is made complex first.
        weight = weight * (size * math.sqrt(share / (1 - share) * diffraction.power(box) / power))
        field.real += scattered.real * weight
        field.imag += scattered.imag * weight
    return diffraction.intensity(field)
