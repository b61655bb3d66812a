"""Night colour and rod noise: each method on one eye's 1440×1600 frame, beside the same in NumPy."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.table import interleaved, show
from entoptic.pipeline.effects import night_colour, rod_noise
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod, bounds
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.ranges import Range
from entoptic.services.process import prepare_jax

ADAPTED_CD_M2 = 0.05


def main(rounds: int = 15) -> None:
    """Prints the tables."""
    prepare_jax()
    displayed = jnp.asarray(np.random.default_rng(0).random((1, 3, 1600, 1440)), jnp.float32)
    scene = displayed * np.float32(0.2)
    host = np.asarray(displayed[0], np.float64)
    weights = np.array(LUMINANCE_WEIGHTS)
    tint = np.array(night_colour.TINT)[:, None, None]

    def with_numpy() -> np.ndarray:
        return host * 0.5 + tint * np.einsum("c,cyx->yx", weights, host) * 0.5

    parts: dict[str, Callable[[], object]] = {
        (numpy := "NumPy: lui, float64"): with_numpy,
        "as little as can be: × 1.01": lambda: jax.block_until_ready(_scaled(displayed)),
    }
    for method in NightMethod:
        for settings in (NightColour(method), NightColour(method, per_pixel=True)):
            name = f"{method}{', per pixel' if settings.per_pixel else ''}"
            parts[name] = lambda settings=settings: jax.block_until_ready(  # type: ignore[misc]
                night_colour.shift(displayed, [ADAPTED_CD_M2], settings, scene)
            )
    for noise in (rod_noise.RodNoise(), rod_noise.RodNoise(own_light=True)):
        parts[f"rod noise{', own light' if noise.own_light else ''}"] = lambda noise=noise: jax.block_until_ready(  # type: ignore[misc]
            rod_noise.add_noise(scene, 0.03, [6.5], 9.8, noise)
        )
    show("Night colour and rod noise, one eye, 1440×1600", interleaved(parts, rounds), numpy)
    _show_bounds(rounds)


@jax.jit
def _scaled(rgb: jax.Array) -> jax.Array:
    return rgb * np.float32(1.01)


def _show_bounds(rounds: int) -> None:
    low = np.random.default_rng(0).random((4, 134, 120)) * 0.2
    range_, change = Range(low, low * 1.5, 12), low / 100
    parts: dict[str, Callable[[], object]] = {}
    for method in NightMethod:
        settings = NightColour(method)
        parts[f"{method}: skipped"] = lambda s=settings: bounds.skipped(range_, ADAPTED_CD_M2, s)  # type: ignore[misc]
        parts[f"{method}: passed on"] = lambda s=settings: bounds.passed_on(change, range_, ADAPTED_CD_M2, s)  # type: ignore[misc]
    noise = rod_noise.RodNoise()
    parts["rod noise: skipped"] = lambda: rod_noise.skipped(range_, 6.5, noise)
    parts["rod noise: passed on"] = lambda: rod_noise.passed_on(change, range_, 6.5, noise)
    show("Their bounds on 134×120 tiles", interleaved(parts, rounds), "lui: skipped")


if __name__ == "__main__":
    main()
