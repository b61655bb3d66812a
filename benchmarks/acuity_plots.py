"""The picture of docs/acuity.md: `python -m benchmarks.acuity_plots docs`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from entoptic.pipeline.effects.acuity import Acuity, AcuityMethod, larson, lightness, reduce_acuity
from entoptic.pipeline.frame import View
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.tracker_bridge.wire import Eye


def main(folder: Path) -> None:
    """Draws widths of the blur by luminance, and a night street at a fiftieth of its light by each method."""
    view = View(300, 300, 300 / 9.82)
    frame = open_scene("night-street").frame(3.0, view, Head(), (Eye.LEFT,)).rgb_cd_m2 / 50
    ppd = view.ppd_centre
    methods = {
        "sharp": None,
        "fit": Acuity(),
        "fit, true filter": Acuity(reference=True),
        "krawczyk": Acuity(AcuityMethod.KRAWCZYK),
        "krawczyk, true filter": Acuity(AcuityMethod.KRAWCZYK, reference=True),
    }
    drawn = Figure(figsize=(15, 10.4), layout="constrained")
    places = drawn.subplots(2, 3)
    y = np.geomspace(1e-6, 10, 400)
    widths = places.flat[0]
    widths.semilogx(y, np.maximum(1 - np.asarray(lightness(y)), 0), label="fit, any display")
    for scale in (9.82, 30.0, 60.0):
        widths.semilogx(y, larson.variance_px2(y, scale, True) ** 0.5, label=f"krawczyk, {scale:g} pixels per degree")
    widths.set(xlabel="cd/m²", ylabel="σ in pixels", ylim=(0, 8), title="Width of the blur")
    widths.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, frameon=False)
    for place, (name, settings) in zip(places.flat[1:], methods.items(), strict=True):
        seen = frame if settings is None else reduce_acuity(frame, ppd, settings)
        shown = np.clip(np.asarray(seen)[0].transpose(1, 2, 0) / 0.02, 0, 1) ** (1 / 2.2)
        place.imshow(shown)
        place.set(title=name, xticks=[], yticks=[])
    drawn.savefig(folder / "acuity.png", dpi=80)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
