"""The pictures of docs/night-vision.md: `python -m benchmarks.night_colour_plots docs`."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import colour
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from entoptic.pipeline import mesopic
from entoptic.pipeline.effects import adaptation, rod_noise, tone
from entoptic.pipeline.effects.encode import srgb_codes
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod, shift
from entoptic.pipeline.effects.night_colour.share import adapted_share
from entoptic.pipeline.frame import View
from entoptic.pipeline.mesopic import WHITE_RATIO
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye

LEVELS_CD_M2 = (3.0, 0.3, 0.03, 0.003, 0.0003)
WAYS = {
    "lui": NightColour(),
    "lui, mesopic": NightColour(mesopic=True),
    "kri-xy": NightColour(NightMethod.KRI_XY),
    "kri-rgb": NightColour(NightMethod.KRI_RGB),
    "bar": NightColour(NightMethod.BAR),
    "rods": NightColour(NightMethod.RODS),
    "rods, mesopic": NightColour(NightMethod.RODS, mesopic=True),
}
STREET_CD_M2 = 0.05


def main(folder: Path) -> None:
    """Draws the pictures."""
    prepare_jax()
    _plot_shares().savefig(folder / "night-vision-shares.png", dpi=90)
    _plot_patches().savefig(folder / "night-vision-colours.png", dpi=90)
    _plot_street().savefig(folder / "night-vision-street.png", dpi=90)
    _plot_noise().savefig(folder / "night-vision-noise.png", dpi=90)


def _plot_shares() -> Figure:
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    luminances = np.geomspace(1e-4, 20, 400)
    left.plot(luminances, adapted_share(luminances, NightColour()), color="#7a5fb0", label="σ (LUI 5.4, KRI 4.27)")
    left.plot(luminances, adapted_share(luminances, NightColour(NightMethod.BAR)), color="#c8553d", label="BAR 11")
    left.plot(luminances, adapted_share(luminances, NightColour(mesopic=True)), color="#2a6fbb", label="CIE 191")
    left.set(xscale="log", xlabel="luminance / (cd/m²)", ylabel="rods' share")
    left.legend(frameon=False, fontsize=9)
    for ratio in (0.25, 0.65, 1.25, WHITE_RATIO):
        seen = [
            100 * (mesopic.mesopic_cd_m2(y, ratio * y, mesopic.adaptation_coefficient(y, ratio * y)) / y - 1)
            for y in luminances.tolist()
        ]
        right.plot(luminances, seen, label=f"S/P {ratio:.3g}")
    right.set(xscale="log", xlabel="photopic luminance / (cd/m²)", ylabel="mesopic over photopic − 1 / %")
    right.legend(frameon=False, fontsize=9)
    for axes in (left, right):
        axes.grid(alpha=0.3)
    return figure


def _plot_patches() -> Figure:
    checker = colour.CCS_COLOURCHECKERS["ColorChecker 2005"]
    xyz = colour.xyY_to_XYZ(np.array(list(checker.data.values())))
    linear = np.clip(colour.XYZ_to_RGB(xyz, "sRGB", checker.illuminant), 0, 1).reshape(4, 6, 3)
    patches = jnp.asarray(np.kron(linear, np.ones((8, 8, 1))).transpose(2, 0, 1)[None], jnp.float32)
    figure = Figure(figsize=(10, 9.6), layout="constrained")
    axes = figure.subplots(len(WAYS), len(LEVELS_CD_M2))
    for row, (name, settings) in enumerate(WAYS.items()):
        for column, adapted_cd_m2 in enumerate(LEVELS_CD_M2):
            panel = axes[row][column]
            panel.imshow(np.asarray(srgb_codes(shift(patches, [adapted_cd_m2], settings), 0.0))[0])
            panel.set(xticks=[], yticks=[])
            if row == 0:
                panel.set_title(f"adapted to {adapted_cd_m2:g} cd/m²", size=10)
        axes[row][0].set_ylabel(name, size=10)
    return figure


def _plot_street() -> Figure:
    view = View(720, 360, 70.0)
    scene = open_scene("night-street").frame(3.0, view, Head(), (Eye.LEFT,)).rgb_cd_m2
    displayed = tone.aces(scene, np.array([adaptation.exposure(STREET_CD_M2)]), 100.0)
    shown = {"cones alone": displayed}
    for name, method in (("lui", NightMethod.LUI), ("rods", NightMethod.RODS)):
        shown[f"{name}, adapted to {STREET_CD_M2:g} cd/m²"] = shift(displayed, [STREET_CD_M2], NightColour(method))
        by_pixel = NightColour(method, per_pixel=True)
        shown[f"{name}, per pixel"] = shift(displayed, [STREET_CD_M2], by_pixel, scene)
    shown["bar, per pixel"] = shift(displayed, [STREET_CD_M2], NightColour(NightMethod.BAR, per_pixel=True), scene)
    figure = Figure(figsize=(10, 8.2), layout="constrained")
    for panel, (name, image) in zip(figure.subplots(3, 2).flat, shown.items(), strict=True):
        panel.imshow(np.asarray(srgb_codes(image, 0.0))[0])
        panel.set_title(name, size=10)
        panel.set_axis_off()
    return figure


def _plot_noise() -> Figure:
    figure = Figure(figsize=(10, 6.6), layout="constrained")
    grid = figure.add_gridspec(2, 3)
    settings, pupil_diameter_mm = rod_noise.RodNoise(on=True), 7.0
    view = View(360, 240, 36.7)
    street = open_scene("night-street").frame(3.0, view, Head(), (Eye.LEFT,)).rgb_cd_m2
    # A street without lamps: their light is cut at ten times the mean of the rest.
    dim = jnp.minimum(street, 0.5)
    for column, mean_cd_m2 in enumerate((1e-3, 1e-4, 1e-5)):
        frame = (dim * np.float32(mean_cd_m2 / float(dim.mean()))).astype(jnp.float32)
        noisy = rod_noise.add_noise(frame, 0.03, [pupil_diameter_mm], view.ppd_centre, settings)
        # Shown as bright as by day, so that it can be printed.
        image = tone.aces(noisy, np.array([0.18 / mean_cd_m2]), 100.0)
        panel = figure.add_subplot(grid[0, column])
        panel.imshow(np.asarray(srgb_codes(shift(image, [mean_cd_m2], NightColour()), 0.0))[0])
        panel.set_title(f"mean {mean_cd_m2:g} cd/m²", size=10)
        panel.set_axis_off()
    panel = figure.add_subplot(grid[1, :])
    luminances = np.geomspace(1e-7, 0.02, 40)
    measured = []
    for luminance_cd_m2 in luminances.tolist():
        flat = jnp.full((1, 3, 300, 300), luminance_cd_m2, jnp.float32)
        grains = np.asarray(rod_noise.add_noise(flat, 0.03, [pupil_diameter_mm], view.ppd_centre, settings), np.float64)
        measured.append(grains[0, 1].std() / luminance_cd_m2)
    rods = rod_noise.RODS_PER_DEG2 * settings.grain_deg**2 * rod_noise.INTEGRATION_S
    trolands = WHITE_RATIO * luminances * math.pi / 4 * pupil_diameter_mm**2
    counts = rods * (rod_noise.ISOMERISATIONS * trolands + rod_noise.THERMAL_PER_S)
    panel.plot(luminances, 1 / np.sqrt(counts), color="#999999", label="Poisson, 1/√N")
    panel.plot(luminances, measured, "o", ms=3, color="#2a6fbb", label="noise as shown")
    panel.set(xscale="log", yscale="log", xlabel="luminance / (cd/m²)", ylabel="scatter / mean", ylim=(0.005, 3))
    panel.legend(frameon=False, fontsize=9)
    panel.grid(alpha=0.3)
    return figure


if __name__ == "__main__":
    main(Path(sys.argv[1]))
