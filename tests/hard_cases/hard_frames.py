"""Small frames, an eye, and the whole way from pixels to code values."""

import numpy as np
import pytest
from numpy.typing import NDArray

from entoptic.pipeline import Effects, EyePose, Frame, Glare, Observer, Perceived, Planning, RenderState, View, perceive

SMALL = Observer(particles=50, gratings=20)
EYE = EyePose(pupil_diameter_mm=4.0)
FOV_DEG = 60.0
SPREAD = Glare()
UNSPREAD = Glare(above_display=True)
"""Below the display's peak nothing scatters: of a frame without such light each pixel goes its way alone."""

PLANNED = Planning()
EVERYTHING = Planning(everything=True)
"""Nothing left out: what a plan leaves out may differ between two frames, by half a code value."""

HEIGHT, WIDTH = 60, 64
"""One size for all: each size is compiled anew."""
VIEW = View(WIDTH, HEIGHT, FOV_DEG)


def grey(luminance: float, height: int = HEIGHT, width: int = WIDTH) -> NDArray[np.float32]:
    return np.full((height, width, 3), luminance, np.float32)


def textured(mean: float, height: int = HEIGHT, width: int = WIDTH) -> NDArray[np.float32]:
    """Coloured noise, from a third to five thirds of the mean."""
    return (mean * np.random.default_rng(1).uniform(0.35, 1.65, (height, width, 3))).astype(np.float32)


def night() -> NDArray[np.float32]:
    """From a moonless night to lamps, every pixel another colour, and some black. (3, y, x), as the next ones."""
    random = np.random.default_rng(5)
    y = 10 ** random.uniform(-4, 3, (1, HEIGHT, WIDTH))
    rgb = y * random.dirichlet((1.0, 1.0, 1.0), (HEIGHT, WIDTH)).transpose(2, 0, 1) * 3
    rgb[:, 20, 10:20] = 0
    return np.asarray(rgb, np.float32)


def starlight() -> NDArray[np.float32]:
    """Dim enough for every pixel to lose detail."""
    random = np.random.default_rng(6)
    return np.asarray(10 ** random.uniform(-6, -1, (3, HEIGHT, WIDTH)), np.float32)


def sun() -> NDArray[np.float32]:
    """1e9 beside 1e-6."""
    rgb = np.full((3, HEIGHT, WIDTH), 1e-6, np.float32)
    rgb[:, 12, 40:42] = 1e9
    rgb[:, 30:] *= 100
    return rgb


DECADES = {"night": night, "starlight": starlight, "sun": sun}
"""Frames of many decades, by name."""
every_frame = pytest.mark.parametrize("name", DECADES)
every_adapted = pytest.mark.parametrize("adapted", [1e-6, 0.01, 0.3, 50.0, 1e6])


def of_name(name: str) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """A frame for the program, and the same for float64."""
    rgb = DECADES[name]()
    return rgb, rgb.astype(np.float64)


def see(
    rgb: np.ndarray,
    eye: EyePose = EYE,
    state: RenderState | None = None,
    dt_s: float = 0.0,
    glare: Glare = SPREAD,
    planning: Planning = PLANNED,
) -> Perceived:
    return perceive(
        Frame.from_rgb(rgb, FOV_DEG),
        eye,
        observer=SMALL,
        state=state,
        dt_s=dt_s,
        effects=Effects(glare=glare),
        planning=planning,
    )


def linear(perceived: Perceived) -> NDArray[np.float32]:
    """What the display shows, (y, x, channel), 1 = its peak."""
    return np.asarray(perceived.linear)[0].transpose(1, 2, 0)
