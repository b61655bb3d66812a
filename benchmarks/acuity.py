"""Acuity on one eye's 1440×1600 frame, by method, and by how much of the frame is dark.

python -m benchmarks.acuity                    the table
python -m benchmarks.acuity docs/acuity.png    the figure of docs/acuity.md
"""

from __future__ import annotations

import sys

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from benchmarks.table import interleaved, show
from entoptic.pipeline.effects.acuity import LIMIT_CD_M2, Acuity, AcuityMethod, larson, lightness, reduce_acuity
from entoptic.pipeline.frame import View
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye

HEIGHT, WIDTH, TILE_PX, PPD = 1600, 1440, 13, 9.82


def dark_share(share: float) -> tuple[Float[Array, "1 3 y x"], NDArray[np.bool_]]:
    """A bright frame whose upper right corner is dark, and which of its tiles are."""
    rng = np.random.default_rng(0)
    y = np.full((HEIGHT, WIDTH), 5.0, np.float32)
    rows, columns = round(HEIGHT * share**0.5), round(WIDTH * share**0.5)
    y[:rows, WIDTH - columns :] = 0.09 * rng.random((rows, columns)) ** 2
    tiles = np.zeros((-(-HEIGHT // TILE_PX), -(-WIDTH // TILE_PX)), bool)
    tiles[: -(-rows // TILE_PX), (WIDTH - columns) // TILE_PX :] = True
    return jnp.asarray(np.broadcast_to(y, (1, 3, HEIGHT, WIDTH))), tiles


def main(rounds: int = 15) -> None:
    """Prints the table."""
    prepare_jax()
    dark, _ = dark_share(1.0)
    assert float(dark.max()) < LIMIT_CD_M2
    copied = jax.jit(lambda rgb: rgb * np.float32(1.5))
    wait = jax.block_until_ready
    krawczyk = Acuity(AcuityMethod.KRAWCZYK)
    parts = {
        "reading and writing the frame": lambda: wait(copied(dark)),
        "fit, whole frame": lambda: wait(reduce_acuity(dark, PPD)),
        "krawczyk, whole frame": lambda: wait(reduce_acuity(dark, PPD, krawczyk)),
    }
    for share in (0.3, 0.1, 0.01):
        rgb, tiles = dark_share(share)
        parts[f"fit, {share:.0%} of the frame dark"] = lambda rgb=rgb, tiles=tiles: wait(  # type: ignore[misc]
            reduce_acuity(rgb, PPD, Acuity(), tiles, TILE_PX)
        )
    show("Acuity, one eye, 1440×1600, float32", interleaved(parts, rounds), "fit, whole frame")


def figure(path: str) -> None:
    """Draws widths of the blur by luminance, and a night street at a fiftieth of its light by each method."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

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
    drawn, places = plt.subplots(2, 3, figsize=(15, 10.4), layout="constrained")
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
    drawn.savefig(path, dpi=80)


if __name__ == "__main__":
    figure(sys.argv[1]) if len(sys.argv) > 1 else main()
