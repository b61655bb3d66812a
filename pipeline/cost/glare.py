"""What accuracy costs in glare: its settings, one at a time off the default, their truth, and the comparison.

The truth is the level `reference`: float64, an FFT of the pupil plane for each of 128 wavelengths, the brightest
sources summed directly. All images are of the default observer, who looks straight ahead.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.cost.comparison import Row, Setting, compare, worst
from entoptic.pipeline.cost.scenes import CostScene, lamps_over_dark, night_street, straight_ahead, sun_over_dark
from entoptic.pipeline.cost.sun_corner import SunCorner, sun_corner
from entoptic.pipeline.effects.glare import Glare, GlareLevel, PreparedGlare, scatter
from entoptic.pipeline.effects.glare.kernel import Mixture, Veil
from entoptic.pipeline.effects.glare.models import (
    GRID,
    PUPIL_STEP_MM,
    GlareModel,
    mixture,
    reference_kernel,
    wave_component,
)
from entoptic.pipeline.frame import Display
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.light_spectra import WAVELENGTHS
from entoptic.pipeline.oracles.glare import reference_glare

PUPIL_MM = 5.0
"""One of those whose kernels are kept. Engineering choice: midway between the limits of 2 and 8."""
REFERENCE_ROUNDS = 0
"""The level `reference` takes half a minute or more: its first call is enough."""
OBSERVER, DISPLAY = Observer(), Display()
NO_FIBRES = msgspec.structs.replace(OBSERVER, gratings=0)

GRIDS, COUNTS, PRECISION, PLANES, PUPILS, LEVELS = (
    "samples along the plane",
    "wavelengths",
    "precision",
    "planes",
    "pupil",
    "level",
)


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much is measured."""

    scenes: Callable[[], tuple[CostScene, ...]]
    """The last one has the sun."""
    grids: tuple[int, ...]
    """Beside the default's."""
    counts: tuple[int, ...]
    """Of wavelengths, beside the default's."""
    levels: tuple[GlareLevel, ...]
    truth_count: int
    """Of the truth's wavelengths."""
    pupils_mm: tuple[float, ...]
    rounds: int
    """Unless others are asked for."""


FULL = Effort(
    scenes=lambda: (night_street(), lamps_over_dark(), sun_over_dark()),
    grids=(256, 512, 1024, 4096),
    counts=(4, 8, 16, 64, 128),
    levels=tuple(GlareLevel),
    truth_count=128,
    pupils_mm=tuple(mm + PUPIL_STEP_MM / 2 for mm in (2, 3, 5, 7)),
    rounds=5,
)
QUICK = Effort(
    scenes=lambda: (sun_over_dark(shrink=8),),
    grids=(256,),
    counts=(4,),
    levels=(GlareLevel.VEIL, GlareLevel.SOURCES, GlareLevel.WINDOW, GlareLevel.FRAME),
    truth_count=8,
    pupils_mm=(PUPIL_MM + PUPIL_STEP_MM / 2,),
    rounds=2,
)


def notes(effort: Effort) -> dict[str, str]:
    """What is varied in each group, and what its times hold."""
    new = "Times: making the kernel, and the level `frame` with it."
    return {
        GRIDS: f"Side of the pupil plane's grid. Below {GRID} it cannot resolve the fibres of the lens: there they are "
        f"left out, and the error is what that leaves out. The truth has {GRID}. {new}",
        COUNTS: f"How many wavelengths are scaled from the one FFT at 575 nm. The truth has {effort.truth_count}, each "
        f"with its own FFT. {new}",
        PRECISION: f"Of pupil plane and FFT. {new}",
        PLANES: "All parts of the eye in the pupil's plane, as in the truth; or the vitreous where it is: not an "
        f"error, but what the two differ by. {new}",
        PUPILS: "A pupil midway between two whose kernels are at hand, at the worst of "
        f"{', '.join(f'{mm:g}' for mm in effort.pupils_mm)} mm: the two kernels blended, or one made for the very "
        "pupil. Error against one made in float64, with the level `frame` as all three. Times of the blend: with both "
        "kernels at hand.",
        LEVELS: "How much of the function is applied to how much of the frame. Times: with the kernel at hand, but "
        f"`reference` makes its own, with {WAVELENGTHS} wavelengths, and ran once.",
    }


@dataclasses.dataclass(frozen=True)
class GlareCost:
    """All that was measured."""

    rows: list[Row]
    """Group by group."""
    corner: SunCorner


def steps(effort: Effort, rounds: int) -> int:
    """How many calls `run` tells of."""
    of_settings = sum((turns + 1) * len(settings) for settings, turns in _settings(effort, rounds))
    of_pupils = len(effort.pupils_mm) * (1 + 2 * (_pupil_rounds(effort, rounds) + 1))
    return len(effort.scenes()) * (1 + of_settings + of_pupils)


def run(effort: Effort, rounds: int, done: Callable[[str], None] = lambda label: None) -> GlareCost:
    """Measures every setting on every scene; `done` is told of each call that has ended."""
    rows: list[Row] = []
    for scene in effort.scenes():
        truth = _truth(scene, effort.truth_count)
        done("truth")
        for settings, turns in _settings(effort, rounds):
            rows += compare(settings, scene, truth, turns, DISPLAY, done)
        rows += _pupils(effort, scene, rounds, done)
    order = list(notes(effort))
    rows.sort(key=lambda row: order.index(row.group))
    return GlareCost(rows, _corner(scene, truth, effort.truth_count))


def _corner(scene: CostScene, truth: Float[np.ndarray, "3 y x"], count: int) -> SunCorner:
    """With a kernel of as many wavelengths as the truth's: what remains is rounding and how the veil is laid."""
    kernel = _new(OBSERVER, Pose(PUPIL_MM), wavelengths=count)(scene)
    images = {
        f"level {level.value}": np.asarray(_glare(scene, *kernel, level))
        for level in (GlareLevel.WINDOW, GlareLevel.FRAME)
    }
    (component, _), *_ = kernel[0]
    return sun_corner(scene, component, images, truth)


Kernel = Callable[[CostScene], tuple[Mixture, Observer, Pose]]
"""What makes a scene's kernel, and of whose eye in which pose it is."""


def _settings(effort: Effort, rounds: int) -> Iterator[tuple[list[Setting], int]]:
    """The settings that take turns, and for how many rounds: those of one grid, as planes of few grids are kept."""
    default = f"default: {GRID}², {WAVELENGTHS} wavelengths, float32, one plane"
    names = {GRIDS: f"{GRID}", COUNTS: f"{WAVELENGTHS}", PRECISION: "float32", PLANES: "one"}
    pose = Pose(PUPIL_MM)
    levels = {
        level: Setting(level.value, {LEVELS: level.value}, _image(_at_hand(pose), level), fresh=False)
        for level in effort.levels
    }
    reference = levels.pop(GlareLevel.REFERENCE, None)
    yield (
        [
            Setting(default, names, _image(_new(OBSERVER, pose))),
            *(
                Setting(f"{count} wavelengths", {COUNTS: f"{count}"}, _image(_new(OBSERVER, pose, wavelengths=count)))
                for count in effort.counts
            ),
            Setting("float64", {PRECISION: "float64"}, _image(_new(OBSERVER, pose, double=True))),
            Setting("vitreous apart", {PLANES: "vitreous apart"}, _image(_new(OBSERVER, pose, multi_plane=True))),
            *levels.values(),
        ],
        rounds,
    )
    for grid in effort.grids:
        fibres = grid >= GRID
        name = f"{grid}" if fibres else f"{grid}, no fibres"
        label = f"{grid}²" if fibres else f"{grid}², no fibres"
        yield [Setting(label, {GRIDS: name}, _image(_new(OBSERVER if fibres else NO_FIBRES, pose, grid=grid)))], rounds
    if reference is not None:
        yield [reference], REFERENCE_ROUNDS


def _pupils(effort: Effort, scene: CostScene, rounds: int, done: Callable[[str], None]) -> Iterator[Row]:
    """A kernel blended of two pupils' against one made for the pupil, each at its worst."""
    rows = []
    for pupil_mm in effort.pupils_mm:
        pose = Pose(pupil_mm)
        truth = np.asarray(_image(_new(OBSERVER, pose, double=True))(scene))
        done(f"{pupil_mm} mm")
        blended, made = {PUPILS: f"blended, {pupil_mm} mm"}, {PUPILS: f"made for it, {pupil_mm} mm"}
        pair = [
            Setting("two pupils blended", blended, _image(_at_hand(pose)), fresh=False, own_truth=True),
            Setting("made for the pupil", made, _image(_new(OBSERVER, pose)), own_truth=True),
        ]
        rows += compare(pair, scene, truth, _pupil_rounds(effort, rounds), DISPLAY, done)
    for label in dict.fromkeys(row.label for row in rows):
        yield worst([row for row in rows if row.label == label])


def _pupil_rounds(effort: Effort, rounds: int) -> int:
    return -(-rounds // len(effort.pupils_mm))


def _truth(scene: CostScene, count: int) -> Float[np.ndarray, "3 y x"]:
    view = scene.frame.view
    kernel, veil, share = _truth_kernel(view.ppd_centre, count)
    return reference_glare(scene.frame.rgb_cd_m2[0], view, kernel, [(veil, share)])


@functools.lru_cache(maxsize=2)
def _truth_kernel(pixels_per_deg: float, count: int) -> tuple[NDArray[np.float64], Veil, float]:
    return reference_kernel(OBSERVER, Pose(PUPIL_MM), pixels_per_deg, count)


def _image(kernel: Kernel, level: GlareLevel = GlareLevel.FRAME) -> Callable[[CostScene], Float[Array, "3 y x"]]:
    return lambda scene: _glare(scene, *kernel(scene), level)


def _glare(
    scene: CostScene, kernel: Mixture, observer: Observer, pose: Pose, level: GlareLevel
) -> Float[Array, "3 y x"]:
    eye = straight_ahead(scene.frame, observer, pose)
    return scatter(scene.frame.rgb_cd_m2[0], eye, PreparedGlare(kernel), Glare(level=level), level)


def _new(observer: Observer, pose: Pose, **settings: Any) -> Kernel:
    """A kernel made anew at every call."""

    def kernel(scene: CostScene) -> tuple[Mixture, Observer, Pose]:
        return ((wave_component(observer, pose, scene.frame.view.ppd_centre, **settings), 1.0),), observer, pose

    return kernel


def _at_hand(pose: Pose) -> Kernel:
    """The program's own: kept from call to call, and blended between pupils."""

    def kernel(scene: CostScene) -> tuple[Mixture, Observer, Pose]:
        ppd = scene.frame.view.ppd_centre
        return mixture(GlareModel.WAVE, OBSERVER, pose, scene.adapted_cd_m2, ppd), OBSERVER, pose

    return kernel
