"""One eye's point-spread function at one wavelength: its pupil plane, and the particles too fine for it."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

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
    box = aperture.pupil_box(observer, pose, n, wavelength_nm, vitreous_apart=vitreous_apart).astype(number, copy=False)
    points = fine_scatter.points(observer, pose, n, wavelength_nm).astype(number, copy=False)
    if vitreous_apart:
        later = aperture.later_planes(observer, pose, n)
        box = diffraction.through_planes(aperture.placed(box, n), later, wavelength_nm)
        points = aperture.placed(points, n)
    size = n if size is None else size
    field = diffraction.field_of(box, size)
    weight, share = fine_scatter.weighting(n, size, observer)
    power = fine_scatter.power(points)
    if share and power:
        scattered = diffraction.field_of(points, size)
        scattered *= weight
        scattered *= number(size * math.sqrt(share / (1 - share) * diffraction.power(box) / power))
        field += scattered
    return diffraction.intensity(field)
