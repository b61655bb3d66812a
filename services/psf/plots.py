"""The pictures and plots of one eye."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Complex, UInt8
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import MaxNLocator

from entoptic.pipeline.optics.aperture import PLANE_M
from entoptic.services.psf.picture import Scale
from entoptic.services.psf.profile import THETA_DEG, Encircled, density

DPI = 100
PAGE, INK = "#101114", "#e8e8e8"
_MARGIN_PX, _BAR_PX, _CAPTION_PX, _CAPTION_WIDTH_PX = 12, 90, 74, 600
ZOOM_MM = 0.4
"""Side of the enlarged part of the pupil plane: 37 lens fibres."""
DARK = 0.01
"""Amplitude below which no phase is shown: what rounding leaves behind an opaque particle has one too."""
_SHOWN_PX = 512
"""Side of the pupil plane's pictures."""


def show(axes: Axes, image: UInt8[np.ndarray, "k k 3"], field_deg: float, *, rings: bool = False) -> None:
    """A picture in degrees, right and up from the light, with a scale bar and, if wanted, rings as far apart."""
    half, step = field_deg / 2, ruler_deg(field_deg)
    axes.imshow(image, extent=(-half, half, -half, half), interpolation="nearest")
    axes.set(xlim=(-half, half), ylim=(-half, half), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    start = -half + 0.04 * field_deg
    axes.plot([start, start + step], [start, start], color="white", lw=2, solid_capstyle="butt")
    axes.text(start, -half + 0.055 * field_deg, f"{step:g}°", color="white", size=8, va="bottom")
    for radius in np.arange(step, half * (1 + 1e-9), step) if rings else ():
        axes.add_patch(Circle((0, 0), radius, fill=False, color="white", lw=0.6, ls=(0, (2, 6)), alpha=0.7))
        # On the diagonal, where no needle of a ring's label hides the halo's left, right, top or bottom.
        at = radius / np.sqrt(2)
        axes.text(at, at, f"{radius:g}°", color="white", size=8, ha="left", va="bottom")


def ruler_deg(field_deg: float) -> float:
    """1, 2 or 5 times a power of ten, of which the field has ten at most."""
    return float(MaxNLocator(10, steps=[1, 2, 5, 10]).tick_values(0, field_deg)[1])


def write_psf(
    path: Path, image: UInt8[np.ndarray, "k k 3"], field_deg: float, scale: Scale, captions: Sequence[str]
) -> None:
    """The colour picture pixel for pixel, its angles and its scale of light."""
    side = image.shape[0]
    width = max(side + 2 * _MARGIN_PX + _BAR_PX, _CAPTION_WIDTH_PX)
    height = side + 2 * _MARGIN_PX + _CAPTION_PX
    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor=PAGE)
    bottom = (_CAPTION_PX + _MARGIN_PX) / height
    show(figure.add_axes((_MARGIN_PX / width, bottom, side / width, side / height)), image, field_deg, rings=True)
    bar = figure.add_axes(((side + 2 * _MARGIN_PX) / width, bottom, 14 / width, side / height))
    shades = ScalarMappable(Normalize(scale.low, scale.high), "gray")
    colours = figure.colorbar(shades, cax=bar, ticks=MaxNLocator(integer=True), format="$10^{%d}$")
    colours.ax.tick_params(colors=INK, labelsize=9)
    colours.set_label("luminous light per steradian / sr⁻¹", color=INK, size=9)
    words: dict[str, Any] = {"color": INK, "size": 8.5, "va": "center", "linespacing": 1.4}
    figure.text(_MARGIN_PX / width, _CAPTION_PX / 2 / height, "\n".join(captions), **words)
    _save(figure, path)


def write_pupil_plane(path: Path, plane: Complex[np.ndarray, "n n"], captions: Sequence[str]) -> None:
    """What of the light passes where, how its phase is turned, and a part of it enlarged; rulers in millimetres."""
    n, side_mm = len(plane), PLANE_M * 1e3
    amplitude = np.abs(plane)
    phase = np.where(amplitude > DARK, np.angle(plane), 0.0)
    # Where the lens fibres are, if there are any: well outside of the middle.
    columns = np.flatnonzero(amplitude[n // 2] > 0)
    centre = n // 2 + int(0.7 * (columns.max() - n // 2)) if columns.size else n // 2
    reach = round(ZOOM_MM / side_mm * n / 2)
    part = phase[n // 2 - reach : n // 2 + reach, centre - reach : centre + reach]
    turned, most = np.sqrt(_block_mean(phase**2)), max(float(np.abs(part).max()), 1e-3)
    figure = Figure(figsize=(15.6, 5.0), dpi=DPI, layout="constrained")
    for axes, image, colours, low, high, middle_mm, wide_mm, title in zip(
        figure.subplots(1, 3),
        (_block_mean(amplitude**2), turned, part),
        ("gray", "magma", "RdBu_r"),
        (0, 0, -most),
        (1, max(turned.max(), 1e-3), most),
        (0, 0, (centre - n // 2) * side_mm / n),
        (side_mm, side_mm, ZOOM_MM),
        ("transmittance of light", "phase, root mean square / rad", f"phase / rad, {ZOOM_MM:g} mm of it"),
        strict=True,
    ):
        half = wide_mm / 2
        extent = (middle_mm - half, middle_mm + half, -half, half)
        shown = axes.imshow(image, colours, vmin=low, vmax=high, extent=extent, interpolation="nearest")
        figure.colorbar(shown, ax=axes, fraction=0.046, pad=0.03)
        axes.set(title=title, xlabel="right / mm", ylabel="up / mm")
    figure.suptitle("   ·   ".join(captions), fontsize=10)
    _save(figure, path)


def _block_mean(image: np.ndarray) -> np.ndarray:
    block = max(len(image) // _SHOWN_PX, 1)
    n = len(image) // block
    return np.asarray(image.reshape(n, block, n, block).mean(axis=(1, 3)))


def write_profiles(path: Path, functions: Mapping[str, Encircled], title: str) -> None:
    """Light per steradian over the angle, and encircled light, one line a function."""
    figure = Figure(figsize=(11, 5), dpi=DPI, layout="constrained")
    left, right = figure.subplots(1, 2)
    low, high = THETA_DEG[1:-1], THETA_DEG[2:]
    for (name, within), style in zip(functions.items(), ("k-", "--", ":"), strict=False):
        left.loglog(np.sqrt(low * high), density(within, low, high), style, label=name, lw=1.4)
        right.semilogx(THETA_DEG[1:], within(THETA_DEG[1:]), style, label=name, lw=1.4)
    left.set(ylabel="light per steradian / sr⁻¹", ylim=(1e-3, None), title="radial mean")
    right.set(ylabel="share of the light within", ylim=(0, 1.02), title="encircled light")
    for axes in (left, right):
        axes.set(xlabel="angle from the light / °", xlim=(2e-3, 90))
        axes.grid(alpha=0.3, lw=0.5)
        axes.legend(fontsize=9, frameon=False)
    figure.suptitle(title, fontsize=9)
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    """The same figure gives the same bytes."""
    figure.savefig(path, metadata={"Software": None})
