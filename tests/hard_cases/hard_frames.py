"""Small frames, an eye, and the whole way from pixels to code values."""

import numpy as np
from numpy.typing import NDArray

from pipeline import Effects, Frame, Glare, Looking, Observer, Perceived, Planning, RenderState, perceive

SMALL = Observer(particles=50, gratings=20)
EYE = Looking(pupil_mm=4.0)
FOV_DEG = 60.0
SPREAD = Glare()
UNSPREAD = Glare(above_display=True)
"""Below the display's peak nothing scatters: of a frame without such light each pixel goes its way alone."""

PLANNED = Planning()
EVERYTHING = Planning(everything=True)
"""Nothing left out: what a plan leaves out may differ between two frames, by half a code value."""

HEIGHT, WIDTH = 60, 64
"""One size for all: each size is compiled anew."""


def grey(luminance: float, height: int = HEIGHT, width: int = WIDTH) -> NDArray[np.float32]:
    return np.full((height, width, 3), luminance, np.float32)


def textured(mean: float, height: int = HEIGHT, width: int = WIDTH) -> NDArray[np.float32]:
    """Coloured noise, from a third to five thirds of the mean."""
    return (mean * np.random.default_rng(1).uniform(0.35, 1.65, (height, width, 3))).astype(np.float32)


def see(
    rgb: np.ndarray,
    eye: Looking = EYE,
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
