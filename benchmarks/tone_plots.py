"""The pictures of docs/tone.md: `python -m benchmarks.tone_plots docs`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from entoptic.pipeline import View
from entoptic.pipeline.effects import tone
from entoptic.pipeline.effects.encode import srgb_codes
from entoptic.pipeline.effects.tone import Hue, Operator, Tone
from entoptic.pipeline.frame import Display
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.tracker_bridge.wire import Eye

ADAPTED_CD_M2 = 0.01, 1.0, 100.0
OWN_CURVE = "log10_of_adapted,share\n-3,0.005\n-1,0.06\n0,0.25\n1,0.6\n2,0.9\n3,1\n"
"""A person's own."""
LAMPS = {
    "white": (1.0, 1.0, 1.0),
    "blue LED": (0.2, 0.45, 8.8),
    "green": (0.016, 1.3701, 0.2326),
    "sodium": (2.67, 0.6045, 0.0),
    "red": (4.7021, 0.0, 0.0),
}
"""Linear Rec.709 at luminance 1."""
COLOURS = {"aces": "#c8553d", "reinhard": "#2a6fbb", "ward": "#3d8b5f", "durand": "#8a5aa8", "curve": "#777777"}


def main(folder: Path) -> None:
    """Draws the pictures."""
    with tempfile.TemporaryDirectory() as temporary:
        (path := Path(temporary) / "own.csv").write_text(OWN_CURVE)
        _plot_curves(str(path)).savefig(folder / "tone-curves.png", dpi=90)
        _plot_scene(str(path)).savefig(folder / "tone-scene.png", dpi=80)
    _plot_lamps().savefig(folder / "tone-lamps.png", dpi=80)


def tones(curve: str) -> dict[str, Tone]:
    """The operators as a person would set them, by name."""
    named = {operator.value: Tone(operator, curve=curve if operator is Operator.CURVE else "") for operator in Operator}
    return named | {f"aces, hue {hue}": Tone(hue=hue) for hue in Hue if hue is not Hue.OKLAB}


def _plot_curves(curve: str) -> Figure:
    figure = Figure(figsize=(11, 6.6), layout="constrained")
    axes = figure.subplots(2, 3)
    for adapted, panel in zip(ADAPTED_CD_M2, axes[0], strict=True):
        light = adapted * np.geomspace(1e-3, 1e3, 400)
        for operator in Operator:
            panel.semilogx(light, _shown(light, adapted, adapted, tones(curve)[operator]), color=COLOURS[operator])
        panel.axvline(adapted, color="black", lw=0.6, ls=":")
        panel.set_title(f"adapted to {adapted:g} cd/m²", size=10)
        panel.grid(alpha=0.3)
    axes[0][0].set_ylabel("share of the display's peak")
    axes[0][2].legend(list(Operator), frameon=False, fontsize=9)

    light = np.geomspace(1e-3, 1e3, 400)
    courses, displays, hues = axes[1]
    for adapted, color in ((1.0, "#3d8b5f"), (0.3, "#7fb796"), (0.03, "#bfdcca")):
        courses.semilogx(light, _shown(light, adapted, 1.0, Tone(Operator.WARD)), color=color, label=f"{adapted:g}")
    courses.legend(frameon=False, fontsize=9, title="adapted to")
    courses.set_title("ward, on the way to 1 cd/m²", size=10)
    for peak, color in ((50.0, "#e8b7ac"), (100.0, "#c8553d"), (400.0, "#8e3623"), (2000.0, "#4f1a0f")):
        share = _shown(light, 1.0, 1.0, Tone(), Display(peak))
        displays.loglog(light, share * peak, color=color, label=f"{peak:g}")
    displays.legend(frameon=False, fontsize=9, title="peak, cd/m²")
    displays.set_title("aces, light of the display / (cd/m²)", size=10)
    displays.set_ylim(0.1, 3000)
    red = np.array([1.0, 0.1, 0.06])
    for hue, style in ((Hue.OKLAB, "-"), (Hue.CLIP, "-."), (Hue.RGB, "--"), (Hue.XYY, ":")):
        image = _shown(light[None] * red[:, None], 1.0, 1.0, Tone(hue=hue))
        for share, color in zip(image, ("#c8352d", "#2f8f4e", "#2a5fbb"), strict=True):
            hues.semilogx(light, share, style, color=color, label=str(hue) if color == "#c8352d" else None)
    hues.legend(frameon=False, fontsize=9, title="hue")
    hues.set_title("aces, components of a red lamp", size=10)
    for panel in axes[1]:
        panel.grid(alpha=0.3)
    figure.supxlabel("luminance of the scene / (cd/m²); red component of the lamp", fontsize=10)
    return figure


def _shown(
    light: np.ndarray, adapted: float, target: float, settings: Tone, display: Display = Display()
) -> np.ndarray:
    """Of greys (pixel) the share, of colours (3, pixel) the components."""
    rgb = jnp.asarray(np.broadcast_to(light, (3, light.shape[-1])), jnp.float32)[None, :, None]
    image = np.asarray(tone.show(rgb, [adapted], [target], settings, display))[0, :, 0]
    return image if light.ndim == 2 else image[1]


def _plot_scene(curve: str) -> Figure:
    """A street by night, 3 s into it, to an eye adapted to 0.3 cd/m² and, with ward, on its way there."""
    rgb = open_scene("night-street").frame(3.0, View(480, 400, 80.0), Head(), (Eye.LEFT,)).rgb_cd_m2
    plans = {name: (settings, 0.3) for name, settings in tones(curve).items()}
    plans["ward, still adapted to 0.03"] = (Tone(Operator.WARD), 0.03)
    figure = Figure(figsize=(12, 10), layout="constrained")
    for panel, (name, (settings, adapted)) in zip(figure.subplots(3, 3).flat, plans.items(), strict=True):
        shown = tone.show(rgb, [adapted], [0.3], settings, Display())
        panel.imshow(np.asarray(srgb_codes(shown, 0.0))[0])
        panel.set_title(name, size=11)
        panel.axis("off")
    return figure


def _plot_lamps() -> Figure:
    """Glows that fall with distance to the power of 2.5, to an eye adapted to 1 cd/m²."""
    size_px = 160
    x, y = np.meshgrid(*[np.arange(size_px) - size_px / 2 + 0.5] * 2)
    glow = 2e3 / (x * x + y * y + 9) ** 1.25 * 30
    figure = Figure(figsize=(12, 10), layout="constrained")
    for row, hue in zip(figure.subplots(len(Hue), len(LAMPS)), Hue, strict=True):
        for panel, (name, lamp) in zip(row, LAMPS.items(), strict=True):
            rgb = jnp.asarray(np.array(lamp)[:, None, None] * glow + 0.01, jnp.float32)[None]
            panel.imshow(np.asarray(srgb_codes(tone.show(rgb, [1.0], [1.0], Tone(hue=hue), Display()), 0.0))[0])
            panel.set_title(f"{name}, {hue}", size=11)
            panel.axis("off")
    return figure


if __name__ == "__main__":
    main(Path(sys.argv[1]))
