"""What accuracy costs in glare: its settings, one at a time off the default, their truth, and the comparison.

The truth is the direct sum over the sphere (oracles/sphere.py) of a function made in float64 with 128 wavelengths, at
some hundred pixels of each scene: half of them anywhere, half where it is brightest. All images are of the default
observer, who looks straight ahead.
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
from entoptic.pipeline.effects.glare import GlareLevel, glare
from entoptic.pipeline.effects.glare.kernel import Mixture
from entoptic.pipeline.effects.glare.models import GRID, PUPIL_STEP_MM, GlareModel, mixture, wave_part
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Display
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.optics.light_spectra import WAVELENGTHS
from entoptic.pipeline.oracles import glare as oracle
from entoptic.pipeline.oracles import sphere

PUPIL_MM = 5.0
"""One of those whose kernels are kept. Engineering choice: midway between the limits of 2 and 8."""
PIXELS = 400
"""At which images are compared. Engineering choice: the direct sum takes a quarter of a second for each."""
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
    truth_count: int
    """Of the truth's wavelengths."""
    pupil_diameters_mm: tuple[float, ...]
    rounds: int
    """Unless others are asked for."""


FULL = Effort(
    scenes=lambda: (night_street(), lamps_over_dark(), sun_over_dark()),
    grids=(256, 512, 1024, 4096),
    counts=(4, 8, 16, 64, 128),
    truth_count=128,
    pupil_diameters_mm=tuple(mm + PUPIL_STEP_MM / 2 for mm in (2, 3, 5, 7)),
    rounds=5,
)
QUICK = Effort(
    scenes=lambda: (sun_over_dark(shrink=8),),
    grids=(256,),
    counts=(4,),
    truth_count=8,
    pupil_diameters_mm=(PUPIL_MM + PUPIL_STEP_MM / 2,),
    rounds=2,
)


def notes(effort: Effort) -> dict[str, str]:
    """What is varied in each group, and what its times hold."""
    new = "Times: making the function, and the level `quarter` with it."
    return {
        GRIDS: f"Side of the pupil plane's grid. Below {GRID} it cannot resolve the fibres of the lens: there they are "
        f"left out, and the error is what that leaves out. The truth has {GRID}. {new}",
        COUNTS: f"How many wavelengths are scaled from the one FFT at 575 nm. The truth has {effort.truth_count}, each "
        f"with its own FFT. {new}",
        PRECISION: f"Of pupil plane and FFT. {new}",
        PLANES: "All parts of the eye in the pupil's plane, as in the truth; or the vitreous where it is: not an "
        f"error, but what the two differ by. {new}",
        PUPILS: "A pupil midway between two whose kernels are at hand: the two blended, or one made for the very "
        "pupil. Error against the direct sum of one made in float64. Times of the blend: with both at hand.",
        LEVELS: "How finely light is pooled before it is scattered. Times: with the function at hand.",
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
        truth = _truth(scene, _new(OBSERVER, Pose(PUPIL_MM), fresh=True, wavelengths=effort.truth_count))
        done("truth")
        for settings, turns in _settings(effort, rounds):
            rows += compare(settings, scene, truth, "the direct sum", turns, done)
        for pupil_diameter_mm in effort.pupil_diameters_mm:
            rows += _pupil(pupil_diameter_mm, scene, _pupil_rounds(effort, rounds), done)
    order = list(notes(effort))
    rows.sort(key=lambda row: order.index(row.effect))
    return GlareCost(rows, _corner(scene, truth, effort.truth_count))


def _corner(scene: CostScene, truth: Float[np.ndarray, "3 n"], count: int) -> SunCorner:
    """With a function of as many wavelengths as the truth's: what remains is rounding and how light is laid."""
    kernel = _new(OBSERVER, Pose(PUPIL_MM), wavelengths=count)(scene)
    images = {
        f"level {level.value}": _at(scene, _glare(scene, kernel[0], level))
        for level in (GlareLevel.QUARTER, GlareLevel.FULL)
    }
    (part, _), *_ = kernel[0]
    return sun_corner(scene, part, images, truth, pixels(scene))


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
    truth: Float[np.ndarray, "3 n"],
    of: str,
    rounds: int,
    done: Callable[[str], None] = lambda label: None,
) -> list[Row]:
    """Each setting's errors against the truth, called `of`, and times in turns; a row for all that it is a value of."""
    timed = interleaved({each.name: functools.partial(each.image, scene) for each in settings}, rounds, done)
    rows = []
    at = pixels(scene)
    for name, varied, _ in settings:
        errors = errors_of(_at(scene, timed[name].result)[:, None], truth[:, None], scene.exposure, DISPLAY)
        row, column = at[errors.worst_x_px]
        errors = dataclasses.replace(errors, worst_x_px=int(column), worst_y_px=int(row))
        rows += [Row(each, name, of, scene.name, errors, timed[name].times) for each in varied]
    return rows


def _settings(effort: Effort, rounds: int) -> Iterator[tuple[list[Setting], int]]:
    """The settings that take turns, and for how many rounds: those of one grid, as planes of few grids are kept."""
    default = f"default: {GRID}², {WAVELENGTHS} wavelengths, float32, one plane"
    pose = Pose(PUPIL_MM)
    levels = [Setting(level.value, [LEVELS], _image(_at_hand(pose), level)) for level in GlareLevel]
    yield (
        [
            Setting(default, [GRIDS, COUNTS, PRECISION, PLANES], _image(_new(OBSERVER, pose))),
            *(
                Setting(f"{count} wavelengths", [COUNTS], _image(_new(OBSERVER, pose, wavelengths=count)))
                for count in effort.counts
            ),
            Setting("float64", [PRECISION], _image(_new(OBSERVER, pose, double=True))),
            Setting("vitreous apart", [PLANES], _image(_new(OBSERVER, pose, multi_plane=True))),
            *levels,
        ],
        rounds,
    )
    for grid in effort.grids:
        name, observer = (f"{grid}²", OBSERVER) if grid >= GRID else (f"{grid}², no fibres", NO_FIBRES)
        yield [Setting(name, [GRIDS], _image(_new(observer, pose, grid=grid)))], rounds


def _pupil(pupil_diameter_mm: float, scene: CostScene, rounds: int, done: Callable[[str], None]) -> list[Row]:
    """A kernel blended of two pupils' against one made for the pupil."""
    pose, mm = Pose(pupil_diameter_mm), f"{pupil_diameter_mm:g} mm"
    truth = _truth(scene, _new(OBSERVER, pose, fresh=True, wavelengths=None))
    done(mm)
    pair = [
        Setting(f"two pupils blended, {mm}", [PUPILS], _image(_at_hand(pose))),
        Setting(f"made for the pupil, {mm}", [PUPILS], _image(_new(OBSERVER, pose, wavelengths=None))),
    ]
    return compare(pair, scene, truth, f"the direct sum, {mm}", rounds, done)


def _pupil_rounds(effort: Effort, rounds: int) -> int:
    return -(-rounds // len(effort.pupil_diameters_mm))


def _truth(scene: CostScene, kernel: Kernel) -> Float[np.ndarray, "3 n"]:
    made, observer, pose = kernel(scene)
    eye = straight_ahead(scene.frame, observer, pose)
    function = oracle.function_of(eye, made, GlareModel.WAVE.value)
    return sphere.glare(scene.frame.rgb_cd_m2[0], scene.frame.view, function, pixels(scene))


@functools.lru_cache(maxsize=8)
def pixels(scene: CostScene) -> NDArray[np.intp]:
    """Where a scene's images are compared: rows and columns (n, 2)."""
    random = np.random.default_rng(8)
    luminance = np.einsum("c,cyx->yx", LUMINANCE_WEIGHTS, np.asarray(scene.frame.rgb_cd_m2[0], np.float64))
    count = min(PIXELS, luminance.size) // 2
    anywhere = random.choice(luminance.size, count, replace=False)
    bright = random.choice(np.argsort(-luminance, axis=None)[: 20 * count], count, replace=False)
    return np.stack(np.unravel_index(np.union1d(anywhere, bright), luminance.shape), axis=1)


def _at(scene: CostScene, image: Array) -> Float[np.ndarray, "3 n"]:
    """An image at those pixels."""
    rows, columns = pixels(scene).T
    return np.asarray(image, np.float64)[:, rows, columns]


def _image(kernel: Kernel, level: GlareLevel = GlareLevel.QUARTER) -> Callable[[CostScene], Float[Array, "3 y x"]]:
    return lambda scene: _glare(scene, kernel(scene)[0], level)


def _glare(scene: CostScene, made: Mixture, level: GlareLevel) -> Float[Array, "3 y x"]:
    return glare(scene.frame.rgb_cd_m2[0], scene.frame.view, made, level)


def _new(observer: Observer, pose: Pose, **settings: Any) -> Kernel:
    """A kernel made anew at every call, of `WAVELENGTHS` unless said otherwise."""
    settings = {"wavelengths": WAVELENGTHS} | settings

    def kernel(scene: CostScene) -> tuple[Mixture, Observer, Pose]:
        return ((wave_part(observer, pose, scene.frame.view.ppd_centre, **settings), 1.0),), observer, pose

    return kernel


def _at_hand(pose: Pose) -> Kernel:
    """The program's own: kept from call to call, and blended between pupils."""

    def kernel(scene: CostScene) -> tuple[Mixture, Observer, Pose]:
        ppd = scene.frame.view.ppd_centre
        return mixture(GlareModel.WAVE, OBSERVER, pose, scene.adapted_cd_m2, ppd), OBSERVER, pose

    return kernel
