"""The parts of the picture that are images, with their scales."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, SymLogNorm, to_rgb
from matplotlib.figure import SubFigure

INK, FAINT = "#1c1d20", "#75787e"
SHOWN_PX = 640
"""Longer side of an image on the page: larger ones are reduced so that no single pixel is lost."""
DARKEST_CD_M2, DECADES = 1e-6, 12
"""Of the scale of luminances: nothing is seen below, and no more decades are told apart by colour."""
VISION = ((0.01, "rods alone ", "top"), (3.0, " cones alone", "bottom"))
"""Where vision changes, in cd/m² (Ferwerda 1996; BAR 3), and on which side its name stands."""


def side_by_side(images: Float[np.ndarray, "eye y x"]) -> Float[np.ndarray, "y eye_x"]:
    """Both eyes' images beside each other."""
    return np.concatenate(list(images), axis=1)


def extreme(image: Float[np.ndarray, "y x"], longer_px: int = SHOWN_PX) -> Float[np.ndarray, "rows columns"]:
    """A smaller image whose every pixel is the one of greatest magnitude of those that it stands for."""
    block = math.ceil(max(image.shape) / longer_px)
    if block == 1:
        return image
    rows, columns = (math.ceil(size / block) for size in image.shape)
    padded = np.zeros((rows * block, columns * block))
    padded[: image.shape[0], : image.shape[1]] = image
    blocks = padded.reshape(rows, block, columns, block).transpose(0, 2, 1, 3).reshape(rows, columns, -1)
    return np.take_along_axis(blocks, np.abs(blocks).argmax(-1)[..., None], -1)[..., 0]


def picture(axes: Axes, image: UInt8[np.ndarray, "y x 3"], gaze_px: Sequence[tuple[float, float]], title: str) -> None:
    """The perceived frame, with where each eye looks."""
    axes.imshow(image, interpolation="antialiased")
    _gaze(axes, gaze_px)
    _bare(axes, title)


def luminances(
    figure: SubFigure,
    axes: Axes,
    cd_m2: Float[np.ndarray, "y x"],
    gaze_px: Sequence[tuple[float, float]],
    lights_px: Sequence[tuple[float, float]],
    adapted_cd_m2: Sequence[float],
) -> None:
    """Luminance in false colour, with the lights that the planner found and its scale in cd/m²."""
    high = max(float(cd_m2.max()), DARKEST_CD_M2 * 10)
    seen = cd_m2[cd_m2 > 0]
    low = max(float(seen.min()) if seen.size else DARKEST_CD_M2, DARKEST_CD_M2, high / 10**DECADES)
    low = min(low, high / 10)
    shown = axes.imshow(cd_m2, norm=LogNorm(low, high, clip=True), cmap="turbo", interpolation="nearest")
    for x, y in lights_px:
        axes.plot(x, y, "o", ms=11, mfc="none", mec="white", mew=1.2)
    _gaze(axes, gaze_px)
    _bare(axes, "luminance; ○ lights that stand out, ▶ adapted to")
    bar = figure.colorbar(shown, ax=axes, fraction=0.046, pad=0.07)
    bar.set_label("cd/m²", color=INK)
    bar.minorticks_off()
    at_bar = bar.ax.get_yaxis_transform()
    for limit, name, side in VISION:
        if low < limit < high:
            bar.ax.axhline(limit, color="white", lw=1.5)
            bar.ax.text(-0.85, limit, name, transform=at_bar, size=8, rotation=90, ha="right", va=side, color=FAINT)
    for adapted in adapted_cd_m2:
        if low <= adapted <= high:
            bar.ax.plot(-0.3, adapted, marker=">", ms=9, color=INK, transform=at_bar, clip_on=False)


def difference(figure: SubFigure, axes: Axes, code_values: Float[np.ndarray, "y x"], title: str) -> None:
    """Full minus planned; the scale is linear up to one code value and logarithmic beyond."""
    small = extreme(code_values)
    most = max(float(np.abs(code_values).max()), 1.0)
    norm, extent = SymLogNorm(1.0, vmin=-most, vmax=most), (0, code_values.shape[1], code_values.shape[0], 0)
    shown = axes.imshow(small, "RdBu_r", norm, interpolation="nearest", extent=extent)
    _bare(axes, title)
    bar = figure.colorbar(shown, ax=axes, fraction=0.046, pad=0.02)
    steps = [step for step in (1, 3, 10, 30, 100, 300) if step <= most]
    ticks = [*(-step for step in reversed(steps)), 0, *steps]
    bar.set_ticks(ticks, labels=[f"{tick:+g}" if tick else "0" for tick in ticks])
    bar.minorticks_off()
    bar.set_label("code values", color=INK)


def touched(
    axes: Axes, image: UInt8[np.ndarray, "y x 3"], change: Float[np.ndarray, "y x"], colour: str, title: str
) -> None:
    """Where an effect changes the picture: the picture in grey, tinted the more the more changed."""
    small = extreme(change)
    grey = image.mean(-1) / 255
    block = math.ceil(max(change.shape) / SHOWN_PX)
    grey = grey[::block, ::block][: small.shape[0], : small.shape[1], None]
    # One code value is tinted a quarter, a hundred and more in full.
    tint = np.where(small >= 1, 0.25 + 0.75 * np.clip(np.log10(np.maximum(small, 1)) / 2, 0, 1), 0.0)[..., None]
    tinted = (1 - tint) * (0.15 + 0.85 * grey) + tint * np.array(to_rgb(colour))
    axes.imshow(tinted, interpolation="antialiased", extent=(0, change.shape[1], change.shape[0], 0))
    _bare(axes, title)
    axes.title.set_color(colour)


def _gaze(axes: Axes, gaze_px: Sequence[tuple[float, float]]) -> None:
    for x, y in gaze_px:
        axes.plot(x, y, "+", ms=14, mew=3, color="black")
        axes.plot(x, y, "+", ms=13, mew=1.4, color="white")


def _bare(axes: Axes, title: str) -> None:
    image = axes.images[0].get_extent()
    axes.set(xlim=sorted(image[:2]), ylim=sorted(image[2:], reverse=True), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    axes.set_title(title, size=11, color=INK)
