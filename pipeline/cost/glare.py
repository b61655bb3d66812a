"""What accuracy costs in glare: its settings, one at a time off the default, their truth, and the comparison.

The truth is the level `reference`: float64, an FFT of the pupil plane for each of 128 wavelengths, the brightest
sources summed directly. All images are of the default observer, who looks straight ahead.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import msgspec
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from entoptic.pipeline.cost.errors import errors_of
from entoptic.pipeline.cost.everything import Row
from entoptic.pipeline.cost.scenes import CostScene, lamps_over_dark, night_street, straight_ahead, sun_over_dark
from entoptic.pipeline.cost.sun_corner import SunCorner, sun_corner
from entoptic.pipeline.cost.timing import interleaved
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
    pupil_diameters_mm: tuple[float, ...]
    rounds: int
    """Unless others are asked for."""


FULL = Effort(
    scenes=lambda: (night_street(), lamps_over_dark(), sun_over_dark()),
    grids=(256, 512, 1024, 4096),
    counts=(4, 8, 16, 64, 128),
    levels=tuple(GlareLevel),
    truth_count=128,
    pupil_diameters_mm=tuple(mm + PUPIL_STEP_MM / 2 for mm in (2, 3, 5, 7)),
    rounds=5,
)
QUICK = Effort(
    scenes=lambda: (sun_over_dark(shrink=8),),
    grids=(256,),
    counts=(4,),
    levels=(GlareLevel.VEIL, GlareLevel.SOURCES, GlareLevel.WINDOW, GlareLevel.FRAME),
    truth_count=8,
    pupil_diameters_mm=(PUPIL_MM + PUPIL_STEP_MM / 2,),
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
        PUPILS: "A pupil midway between two whose kernels are at hand: the two blended, or one made for the very "
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
    of_pupils = len(effort.pupil_diameters_mm) * (1 + 2 * (_pupil_rounds(effort, rounds) + 1))
    return len(effort.scenes()) * (1 + of_settings + of_pupils)


def run(effort: Effort, rounds: int, done: Callable[[str], None] = lambda label: None) -> GlareCost:
    """Measures every setting on every scene; `done` is told of each call that has ended."""
    rows: list[Row] = []
    for scene in effort.scenes():
        truth = _truth(scene, effort.truth_count)
        done("truth")
        for settings, turns in _settings(effort, rounds):
            rows += compare(settings, scene, truth, "reference", turns, done)
        for pupil_diameter_mm in effort.pupil_diameters_mm:
            rows += _pupil(pupil_diameter_mm, scene, _pupil_rounds(effort, rounds), done)
    order = list(notes(effort))
    rows.sort(key=lambda row: order.index(row.effect))
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


class Setting(NamedTuple):
    """One way to compute an image in cd/m², linear Rec.709, and what it is one value of."""

    name: str
    varied: Sequence[str]
    image: Callable[[CostScene], Float[Array, "3 y x"]]


def compare(
    settings: Sequence[Setting],
    scene: CostScene,
    truth: Float[np.ndarray, "3 y x"],
    of: str,
    rounds: int,
    done: Callable[[str], None] = lambda label: None,
) -> list[Row]:
    """Each setting's errors against the truth, called `of`, and times in turns; a row for all that it is a value of."""
    timed = interleaved({each.name: functools.partial(each.image, scene) for each in settings}, rounds, done)
    rows = []
    for name, varied, _ in settings:
        errors = errors_of(np.asarray(timed[name].result), truth, scene.exposure, DISPLAY)
        rows += [Row(each, name, of, scene.name, errors, timed[name].times) for each in varied]
    return rows


def _settings(effort: Effort, rounds: int) -> Iterator[tuple[list[Setting], int]]:
    """The settings that take turns, and for how many rounds: those of one grid, as planes of few grids are kept."""
    default = f"default: {GRID}², {WAVELENGTHS} wavelengths, float32, one plane"
    pose = Pose(PUPIL_MM)
    levels = {level: Setting(level.value, [LEVELS], _image(_at_hand(pose), level)) for level in effort.levels}
    reference = levels.pop(GlareLevel.REFERENCE, None)
    yield (
        [
            Setting(default, [GRIDS, COUNTS, PRECISION, PLANES], _image(_new(OBSERVER, pose))),
            *(
                Setting(f"{count} wavelengths", [COUNTS], _image(_new(OBSERVER, pose, wavelengths=count)))
                for count in effort.counts
            ),
            Setting("float64", [PRECISION], _image(_new(OBSERVER, pose, double=True))),
            Setting("vitreous apart", [PLANES], _image(_new(OBSERVER, pose, multi_plane=True))),
            *levels.values(),
        ],
        rounds,
    )
    for grid in effort.grids:
        name, observer = (f"{grid}²", OBSERVER) if grid >= GRID else (f"{grid}², no fibres", NO_FIBRES)
        yield [Setting(name, [GRIDS], _image(_new(observer, pose, grid=grid)))], rounds
    if reference is not None:
        yield [reference], REFERENCE_ROUNDS


def _pupil(pupil_diameter_mm: float, scene: CostScene, rounds: int, done: Callable[[str], None]) -> list[Row]:
    """A kernel blended of two pupils' against one made for the pupil."""
    pose, mm = Pose(pupil_diameter_mm), f"{pupil_diameter_mm:g} mm"
    truth = np.asarray(_image(_new(OBSERVER, pose, double=True, wavelengths=None))(scene))
    done(mm)
    pair = [
        Setting(f"two pupils blended, {mm}", [PUPILS], _image(_at_hand(pose))),
        Setting(f"made for the pupil, {mm}", [PUPILS], _image(_new(OBSERVER, pose, wavelengths=None))),
    ]
    return compare(pair, scene, truth, f"float64, {mm}", rounds, done)


def _pupil_rounds(effort: Effort, rounds: int) -> int:
    return -(-rounds // len(effort.pupil_diameters_mm))


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
    """A kernel made anew at every call, of `WAVELENGTHS` unless said otherwise."""
    settings = {"wavelengths": WAVELENGTHS} | settings

    def kernel(scene: CostScene) -> tuple[Mixture, Observer, Pose]:
        return ((wave_component(observer, pose, scene.frame.view.ppd_centre, **settings), 1.0),), observer, pose

    return kernel


def _at_hand(pose: Pose) -> Kernel:
    """The program's own: kept from call to call, and blended between pupils."""

    def kernel(scene: CostScene) -> tuple[Mixture, Observer, Pose]:
        ppd = scene.frame.view.ppd_centre
        return mixture(GlareModel.WAVE, OBSERVER, pose, scene.adapted_cd_m2, ppd), OBSERVER, pose

    return kernel
