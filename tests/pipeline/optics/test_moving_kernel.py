"""The kernel of an eye in motion against the one made for its very pose, part by part."""

import dataclasses
import functools

import numpy as np
import pytest

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.observer import Observer, OcularDynamics
from entoptic.pipeline.optics import light_spectra, moving_kernel, ocular_dynamics, whole
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.monochromatic import monochromatic

EYE = Observer()
PPD = 9.82
STEPS = ((5.0, 0.6), (5.25, 0.4))
PUPIL_MM = 5.1


@functools.cache
def deformed_lens() -> np.ndarray:
    """1.55 s into its motion it is 14 µm wider at its equator."""
    living = Observer(ocular_dynamics=OcularDynamics(microfluctuations=True, lens=True))
    state = ocular_dynamics.step(ocular_dynamics.at_rest(living), living, 1.55, PUPIL_MM)
    lens_m = ocular_dynamics.pose_of(state, living, PUPIL_MM, 1.0, measured=True).lens_m
    assert lens_m is not None
    return lens_m


def luminance(kernel: np.ndarray) -> np.ndarray:
    """Of a white light."""
    return np.asarray(np.einsum("o,oijk->jk", np.array(LUMINANCE_WEIGHTS), kernel))


def weights() -> tuple[np.ndarray, np.ndarray]:
    return light_spectra.primary_weights(light_spectra.wavelengths_for(PPD))


def moving(pose: Pose, steps: tuple[tuple[float, float], ...] = STEPS, eye: Observer = EYE) -> np.ndarray:
    """The eyes at rest and what the motion adds to them."""
    at_rest = moving_kernel.rests(eye, pose, steps, PPD)
    kernels = [
        moving_kernel.resting_kernel(eye, rest.pupil_diameter_mm, rest.focus_d)(*weights(), PPD)[0] for rest in at_rest
    ]
    return np.asarray(moving_kernel.mean_of(kernels, at_rest) + change(pose, at_rest, eye))


def change(pose: Pose, at_rest: list[moving_kernel.Rest], eye: Observer = EYE, **reach: int) -> np.ndarray:
    return moving_kernel.change_kernel(eye, pose, at_rest, PPD)(*weights(), PPD, **reach)[0]


def made_for_it(pose: Pose) -> np.ndarray:
    return whole.wave_kernel(monochromatic(EYE, pose), *weights(), PPD, EYE.age_years, 0.5)[0]


@functools.cache
def at_rest() -> np.ndarray:
    return luminance(made_for_it(Pose(PUPIL_MM)))


REST = Pose(PUPIL_MM)
PARTS = {
    # Part: its pose, and how far the light may be off within 1°, from 1° to 2°, and from 2° to 3.7°.
    "focus": (dataclasses.replace(REST, defocus_d=0.3), (0.005, 0.01, 0.03)),
    "vitreous": (dataclasses.replace(REST, vitreous_deg=(4.0, -1.5)), (0.006, 0.02, 0.04)),
    "lids": (dataclasses.replace(REST, openness=0.6), (0.01, 0.02, 0.08)),
    "lids half closed": (dataclasses.replace(REST, openness=0.5), (0.01, 0.03, 0.15)),
    "lashes": (dataclasses.replace(REST, openness=0.6, lashes=True), (0.015, 0.06, 0.12)),
}


def off(kernel: np.ndarray, truth: np.ndarray, low_deg: float, high_deg: float) -> float:
    """Sum of the differences in a ring over its light."""
    y, x = (np.indices(truth.shape) - len(truth) // 2) / PPD
    ring = (np.hypot(x, y) > low_deg) & (np.hypot(x, y) <= high_deg)
    return float(np.abs(kernel - truth)[ring].sum() / truth[ring].sum())


RINGS = ((0.2, 1.0), (1.0, 2.0), (2.0, 3.7))


@pytest.mark.parametrize("part", [*PARTS, "lens"])
def test_each_parts_motion_is_as_near_as_the_docs_say(part: str) -> None:
    pose, limits = PARTS.get(part, (dataclasses.replace(REST, lens_m=deformed_lens()), (0.005, 0.01, 0.03)))
    kernel, truth = moving(pose), made_for_it(pose)
    found, true = luminance(kernel), luminance(truth)
    errors = [off(found, true, *ring) for ring in RINGS]
    moved = [off(at_rest(), true, *ring) for ring in RINGS]
    print(part, [f"{error:.2%} of a change of {change:.2%}" for error, change in zip(errors, moved, strict=True)])
    for error, limit in zip(errors, limits, strict=True):
        assert error < limit
    middle = len(true) // 2
    assert found[middle, middle] == pytest.approx(true[middle, middle], rel=0.01)
    np.testing.assert_allclose(kernel.sum(axis=(2, 3)), truth.sum(axis=(2, 3)), atol=2e-3)
    assert found.min() > -1e-9


@pytest.mark.parametrize("part", ["vitreous", "lids", "lashes"])
def test_it_shows_the_motion_and_not_the_eye_at_rest(part: str) -> None:
    pose, _ = PARTS[part]
    true, found = luminance(made_for_it(pose)), luminance(moving(pose))
    assert off(found, true, 0.2, 1.0) < 0.25 * off(at_rest(), true, 0.2, 1.0)


def test_nothing_jumps_where_the_pupil_passes_a_step() -> None:
    below = luminance(moving(Pose(5.249, vitreous_deg=(0.3, 0.0)), ((5.0, 0.004), (5.25, 0.996))))
    above = luminance(moving(Pose(5.251, vitreous_deg=(0.3, 0.0)), ((5.25, 0.996), (5.5, 0.004))))
    for ring in RINGS:
        assert off(below, above, *ring) < 0.005


def test_kernels_at_rest_serve_again_while_pupil_and_focus_waver() -> None:
    moving_kernel._resting.cache_clear()
    for number in range(12):
        moving(Pose(5.1 + 0.01 * number, defocus_d=0.3 + 0.003 * number, vitreous_deg=(0.1, 0.0)))
    assert moving_kernel._resting.cache_info().misses == len(STEPS)


def test_an_eye_without_fibres_needs_none() -> None:
    bare = Observer(gratings=0)
    pose = Pose(4.0, vitreous_deg=(1.0, 0.0))
    kernel = moving(pose, ((4.0, 1.0),), bare)
    truth = whole.wave_kernel(monochromatic(bare, pose), *weights(), PPD, EYE.age_years, 0.5)[0]
    assert off(luminance(kernel), luminance(truth), 0.2, 1.5) < 0.01


def test_a_part_of_the_change_is_the_middle_of_it_all() -> None:
    pose = Pose(4.0, vitreous_deg=(1.0, 0.0), openness=0.6)
    at_rest = moving_kernel.rests(EYE, pose, ((4.0, 1.0),), PPD)
    whole_of_it, part = change(pose, at_rest), change(pose, at_rest, radius_px=12)
    middle = whole_of_it.shape[-1] // 2
    inner = slice(middle - 12, middle + 13)
    np.testing.assert_allclose(part, whole_of_it[..., inner, inner], rtol=0, atol=1e-9)


def test_an_eye_at_rest_adds_nothing_to_itself() -> None:
    assert np.abs(change(Pose(5.0), [moving_kernel.Rest(5.0, EYE.defocus_d, 1.0)])).max() < 1e-12


def test_the_change_has_no_light_of_its_own() -> None:
    """What it takes away here it adds there, at any size of cells."""
    pose = Pose(PUPIL_MM, defocus_d=0.3, vitreous_deg=(4.0, -1.5), openness=0.6)
    make = moving_kernel.change_kernel(EYE, pose, moving_kernel.rests(EYE, pose, STEPS, PPD), PPD)
    for pixels_per_deg in (PPD / 4, PPD, 3 * PPD):
        found = make(*weights(), pixels_per_deg)[0]
        assert np.abs(found.sum(axis=(2, 3))).max() < 2e-3
        assert np.abs(found).sum() > 0.02
