"""The pictures and plots of one eye."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Complex, UInt8
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from entoptic.pipeline.optics.aperture import PLANE_M
from entoptic.services.psf import layout
from entoptic.services.psf.picture import Scale
from entoptic.services.psf.profile import THETA_DEG, Encircled, density

_MARGIN_PX, _BAR_PX, _CAPTION_PX, _CAPTION_WIDTH_PX = 12, 90, 74, 600
ZOOM_MM = 0.4
"""Side of the enlarged part of the pupil plane: 37 lens fibres."""
DARK = 0.01
"""Amplitude below which no phase is shown: what rounding leaves behind an opaque particle has one too."""
_SHOWN_PX = 512
"""Side of the pupil plane's pictures."""


def write_psf(
    path: Path, image: UInt8[np.ndarray, "k k 3"], field_deg: float, scale: Scale, captions: Sequence[str]
) -> None:
    """The colour picture pixel for pixel, its angles and its scale of light."""
    side = image.shape[0]
    width = max(side + 2 * _MARGIN_PX + _BAR_PX, _CAPTION_WIDTH_PX)
    height = side + 2 * _MARGIN_PX + _CAPTION_PX
    figure = Figure(figsize=(width / layout.DPI, height / layout.DPI), dpi=layout.DPI, facecolor=layout.PAGE)
    bottom = _CAPTION_PX + _MARGIN_PX
    axes = figure.add_axes((_MARGIN_PX / width, bottom / height, side / width, side / height))
    layout.show(axes, image, field_deg, rings=True)
    bar = figure.add_axes(((side + 2 * _MARGIN_PX) / width, bottom / height, 14 / width, side / height))
    grey = LinearSegmentedColormap.from_list("code", ["black", "white"])
    colours = figure.colorbar(ScalarMappable(Normalize(scale.low, scale.high), grey), cax=bar)
    exponents = range(math.ceil(scale.low), math.floor(scale.high) + 1)
    colours.set_ticks(list(exponents), labels=[f"$10^{{{exponent}}}$" for exponent in exponents])
    colours.ax.tick_params(colors=layout.INK, labelsize=9)
    colours.set_label("luminous light per steradian / sr⁻¹", color=layout.INK, size=9)
    figure.text(
        _MARGIN_PX / width, _CAPTION_PX / 2 / height, "\n".join(captions), color=layout.INK, size=8.5, va="center",
        linespacing=1.4,
    )  # fmt: skip
    layout.save(figure, path)


def write_pupil_plane(path: Path, plane: Complex[np.ndarray, "n n"], captions: Sequence[str]) -> None:
    """What of the light passes where, how its phase is turned, and a part of it enlarged; rulers in millimetres."""
    n = len(plane)
    block = max(n // _SHOWN_PX, 1)
    amplitude = np.abs(plane)
    phase = np.where(amplitude > DARK, np.angle(plane), 0.0)
    half_mm = PLANE_M * 1e3 / 2
    figure = Figure(figsize=(15.6, 5.0), dpi=layout.DPI)
    room = {"left": 0.04, "right": 0.96, "bottom": 0.1, "top": 0.86, "wspace": 0.3}
    whole, turned, zoom = figure.subplots(1, 3, gridspec_kw=room)
    transmittance = _block_mean(amplitude**2, block)
    _plane_image(figure, whole, transmittance, half_mm, "gray", (0, 1), "transmittance of light")
    spread = np.sqrt(np.maximum(_block_mean(phase**2, block), 0))
    _plane_image(
        figure, turned, spread, half_mm, "magma", (0, max(spread.max(), 1e-3)), "phase, root mean square / rad"
    )
    # Where the lens fibres are, if there are any: well outside of the middle.
    columns = np.flatnonzero(amplitude[n // 2] > 0)
    centre = n // 2 + int(0.7 * (columns.max() - n // 2)) if columns.size else n // 2
    reach = round(ZOOM_MM * 1e-3 / PLANE_M * n / 2)
    part = phase[n // 2 - reach : n // 2 + reach, centre - reach : centre + reach]
    at_mm = (centre - n // 2) * PLANE_M * 1e3 / n
    limit = max(float(np.abs(part).max()), 1e-3)
    extent = (at_mm - ZOOM_MM / 2, at_mm + ZOOM_MM / 2, -ZOOM_MM / 2, ZOOM_MM / 2)
    shown = zoom.imshow(part, extent=extent, cmap="RdBu_r", vmin=-limit, vmax=limit, interpolation="nearest")
    figure.colorbar(shown, ax=zoom, fraction=0.046, pad=0.03)
    zoom.set(title=f"phase / rad, {ZOOM_MM:g} mm of it", xlabel="right / mm", ylabel="up / mm")
    figure.suptitle("   ·   ".join(captions), fontsize=10)
    layout.save(figure, path)


def _plane_image(
    figure: Figure,
    axes: Axes,
    image: NDArray[np.floating],
    half_mm: float,
    colours: str,
    limits: tuple[float, float],
    name: str,
) -> None:
    extent = (-half_mm, half_mm, -half_mm, half_mm)
    shown = axes.imshow(image, extent=extent, cmap=colours, vmin=limits[0], vmax=limits[1], interpolation="nearest")
    figure.colorbar(shown, ax=axes, fraction=0.046, pad=0.03)
    axes.set(title=name, xlabel="right / mm", ylabel="up / mm")


def _block_mean(image: NDArray[np.floating], block: int) -> NDArray[np.floating]:
    n = len(image) // block
    return np.asarray(image.reshape(n, block, n, block).mean(axis=(1, 3)))


def write_profiles(path: Path, functions: Sequence[tuple[str, Encircled]], title: str) -> None:
    """Light per steradian over the angle, and encircled light, one line a function."""
    figure = Figure(figsize=(11, 5), dpi=layout.DPI)
    room = {"left": 0.08, "right": 0.985, "bottom": 0.11, "top": 0.87, "wspace": 0.2}
    left, right = figure.subplots(1, 2, gridspec_kw=room)
    low, high = THETA_DEG[1:-1], THETA_DEG[2:]
    for (name, within), style in zip(functions, ("-", "--", ":", "-."), strict=False):
        colour = "black" if style == "-" else None
        left.loglog(np.sqrt(low * high), density(within, low, high), style, label=name, color=colour, lw=1.4)
        right.semilogx(THETA_DEG[1:], within(THETA_DEG[1:]), style, label=name, color=colour, lw=1.4)
    left.set(ylabel="light per steradian / sr⁻¹", ylim=(1e-3, None), title="radial mean")
    right.set(ylabel="share of the light within", ylim=(0, 1.02), title="encircled light")
    for axes in (left, right):
        axes.set(xlabel="angle from the light / °", xlim=(2e-3, 90))
        axes.grid(alpha=0.3, lw=0.5)
        axes.legend(fontsize=9, frameon=False)
    figure.suptitle(title, fontsize=10)
    layout.save(figure, path)
