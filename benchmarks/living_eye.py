"""An eye in motion, 720×800, night street: what its kernel costs, and how many frames a second it leaves."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np

from benchmarks.table import interleaved, show
from entoptic.pipeline import EyePose, Observer, OcularDynamics, RenderState, View, perceive
from entoptic.pipeline.effects.glare import models
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.optics import light_spectra, moving_kernel, ocular_dynamics, whole
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.monochromatic import monochromatic
from entoptic.pipeline.optics.ocular_dynamics import SaccadeImpulse
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye

VIEW = View(720, 800, 104.0)
PUPIL_MM = 5.1
DT_S = 1 / 60
LIVING = {
    "lens, vitreous, lids": OcularDynamics(microfluctuations=True, lens=True, vitreous=True, lids=True),
    "vitreous, lids": OcularDynamics(vitreous=True, lids=True),
    "nothing moves": OcularDynamics(),
}
RINGS_DEG = ((0.2, 1.0), (1.0, 2.0), (2.0, 3.7))


def main(rounds: int = 15) -> None:
    """Prints what a kernel and a frame take, and how far each part's motion is from a kernel made for the pose."""
    prepare_jax()
    observer, pose = Observer(), _poses()["all"]
    nm, weights = light_spectra.primary_weights(light_spectra.wavelengths_for(VIEW.ppd_centre))
    kernels: dict[str, Callable[[], object]] = {
        "made for the pose": lambda: whole.wave_kernel(
            monochromatic(observer, pose), nm, weights, VIEW.ppd_centre, observer.age_years, 0.5
        ),
        "what its motion changes": lambda: moving_kernel.change_kernel(
            observer, pose, _at_rest(observer, pose, VIEW.ppd_centre), VIEW.ppd_centre
        )(nm, weights, VIEW.ppd_centre),
    }
    show(f"A kernel, {VIEW.ppd_centre:.1f} pixels per degree", interleaved(kernels, rounds), "made for the pose")
    frames = {name: _frames(Observer(ocular_dynamics=living)) for name, living in LIVING.items()}
    times = interleaved(frames, rounds)
    show("A frame, 720×800, the planner's choice", times, "nothing moves")
    for name, ms in times.items():
        print(f"{name}: {1e3 / np.median(ms):.1f} frames a second")
    for pixels_per_deg in (VIEW.ppd_centre, 2 * VIEW.ppd_centre, 20.0):
        _errors(observer, pixels_per_deg)


def _poses() -> dict[str, Pose]:
    """Of an eye whose accommodation has wavered by 0.4 D, just after a saccade of 4°."""
    living = Observer(ocular_dynamics=LIVING["lens, vitreous, lids"])
    state = ocular_dynamics.step(ocular_dynamics.at_rest(living), living, 1.55, PUPIL_MM, [SaccadeImpulse(8.0, 3.0)])
    full, rest = ocular_dynamics.pose_of(state, living, PUPIL_MM, 0.6, measured=True), Pose(PUPIL_MM)
    return {
        "focus": dataclasses.replace(rest, defocus_d=full.defocus_d),
        "lens": dataclasses.replace(rest, lens_m=full.lens_m),
        "vitreous": dataclasses.replace(rest, vitreous_deg=full.vitreous_deg),
        "lids 0.6 open": dataclasses.replace(rest, openness=0.6),
        "lids 0.5 open": dataclasses.replace(rest, openness=0.5),
        "lids 0.4 open": dataclasses.replace(rest, openness=0.4),
        "lids 0.6 open, lashes": dataclasses.replace(rest, openness=0.6, lashes=True),
        "all": full,
    }


def _frames(observer: Observer) -> Callable[[], object]:
    """One frame after another of an eye that makes a saccade now and then and whose lids waver."""
    frame = open_scene("night-street").frame(3.0, VIEW, Head(), (Eye.LEFT,))
    state: RenderState | None = None
    numbers = itertools.count()

    def perceive_next() -> object:
        nonlocal state
        number = next(numbers)
        turns = (SaccadeImpulse(4.0, 1.0),) if number % 12 == 0 else ()
        pose = EyePose(pupil_diameter_mm=PUPIL_MM, openness=0.6 + 0.05 * np.sin(number).item(), saccade_impulses=turns)
        seen = perceive(frame, pose, observer=observer, state=state, dt_s=DT_S)
        state = seen.state
        return seen.image

    return perceive_next


def _at_rest(observer: Observer, pose: Pose, pixels_per_deg: float) -> list[moving_kernel.Rest]:
    return moving_kernel.rests(observer, pose, models.pupil_steps(PUPIL_MM), pixels_per_deg)


def _in_motion(
    observer: Observer, pose: Pose, nm: np.ndarray, weights: np.ndarray, pixels_per_deg: float
) -> np.ndarray:
    at_rest = _at_rest(observer, pose, pixels_per_deg)
    kernels = [
        moving_kernel.resting_kernel(observer, rest.pupil_diameter_mm, rest.focus_d)(nm, weights, pixels_per_deg)[0]
        for rest in at_rest
    ]
    change, _ = moving_kernel.change_kernel(observer, pose, at_rest, pixels_per_deg)(nm, weights, pixels_per_deg)
    return np.asarray(moving_kernel.mean_of(kernels, at_rest) + change)


def _errors(observer: Observer, pixels_per_deg: float) -> None:
    """Sum of the differences in a ring over its light, of white light; and how much the motion itself changes."""
    nm, weights = light_spectra.light_weights("D65", light_spectra.wavelengths_for(pixels_per_deg))
    luminance, eye = weights @ np.array(LUMINANCE_WEIGHTS), (observer.age_years, 0.5)

    def made(pose: Pose) -> np.ndarray:
        return whole.wave_kernel(monochromatic(observer, pose), nm, luminance, pixels_per_deg, *eye)[0]

    rest = made(Pose(PUPIL_MM))
    y, x = (np.indices(rest.shape) - len(rest) // 2) / pixels_per_deg
    away = np.hypot(x, y)
    rings = [(away > low) & (away <= high) for low, high in RINGS_DEG]
    print(f"\n### In motion against made for the pose, {pixels_per_deg:.1f} pixels per degree: error / change\n")
    print("| | " + " | ".join(f"{low}–{high}°" for low, high in RINGS_DEG) + " |\n|---|---:|---:|---:|")
    for name, pose in _poses().items():
        truth = made(pose)
        found = _in_motion(observer, pose, nm, luminance, pixels_per_deg)
        cells = [
            f"{np.abs(found - truth)[ring].sum() / truth[ring].sum():.2%} / "
            f"{np.abs(rest - truth)[ring].sum() / truth[ring].sum():.2%}"
            for ring in rings
        ]
        print(f"| {name} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
