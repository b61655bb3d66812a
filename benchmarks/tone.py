"""Tone mapping of one eye's 1440×1600 frame, beside a copy of it and the default plainly in NumPy; and its bounds."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.table import interleaved, show
from entoptic.pipeline import View
from entoptic.pipeline.effects import tone
from entoptic.pipeline.effects.adaptation import exposure
from entoptic.pipeline.effects.tone import Hue, Operator, Tone
from entoptic.pipeline.frame import Display, Encoding
from entoptic.pipeline.measure import luminance
from entoptic.pipeline.ranges import Range
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.services.process import prepare_jax
from entoptic.tracker_bridge.wire import Eye

ADAPTED_CD_M2, TARGET_CD_M2 = 0.05, 0.5
OWN_CURVE = "log10_of_adapted,share\n-3,0.005\n-1,0.06\n0,0.25\n1,0.6\n2,0.9\n3,1\n"
"""A person's own, for the timing and for the pictures."""


def main(rounds: int = 15) -> None:
    """Prints the tables."""
    prepare_jax()
    scene = open_scene("night-street")
    rgb = scene.frame(3.0, View(1440, 1600, 104.0), Head(), (Eye.LEFT,)).rgb_cd_m2
    with tempfile.TemporaryDirectory() as folder:
        (path := Path(folder) / "own.csv").write_text(OWN_CURVE)
        frame(rgb, str(path), rounds)
        bounds(np.asarray(rgb[0], np.float64), str(path), rounds)


def tones(curve: str) -> dict[str, Tone]:
    """The operators as a person would set them, by name."""
    named = {operator.value: Tone(operator, curve=curve if operator is Operator.CURVE else "") for operator in Operator}
    return named | {f"aces, hue {hue}": Tone(hue=hue) for hue in (Hue.RGB, Hue.XYY)}


def frame(rgb: jax.Array, curve: str, rounds: int) -> None:
    wait, display = jax.block_until_ready, Display()

    def shown(settings: Tone) -> Callable[[], object]:
        return lambda: wait(tone.show(rgb, [ADAPTED_CD_M2], [TARGET_CD_M2], settings, display))

    host = np.asarray(rgb)

    def plainly() -> np.ndarray:
        x = np.clip(host.astype(np.float64) * exposure(ADAPTED_CD_M2), 0, 1e4)
        return np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1)

    copy = jax.jit(lambda values: values + jnp.float32(1))
    parts: dict[str, Callable[[], object]] = {"a copy of the frame": lambda: wait(copy(rgb))}
    parts |= {name: shown(settings) for name, settings in tones(curve).items()}
    parts["aces plainly, NumPy, float64"] = plainly
    show("Tone mapping, one eye, 1440×1600, float32", interleaved(parts, rounds), "a copy of the frame")


def bounds(rgb: np.ndarray, curve: str, rounds: int) -> None:
    tile_px = 13
    values = np.concatenate([rgb, luminance(rgb)[None]])
    pad = [(0, 0), *((0, -size % tile_px) for size in rgb.shape[1:])]
    cut = np.pad(values, pad, mode="edge")
    rows, columns = (size // tile_px for size in cut.shape[1:])
    cut = cut.reshape(4, rows, tile_px, columns, tile_px)
    range_ = Range(cut.min((2, 4)), cut.max((2, 4)), tile_px)
    change, display = 0.01 * range_.high, Display()
    state = (ADAPTED_CD_M2, TARGET_CD_M2)
    parts: dict[str, Callable[[], object]] = {}
    for name, settings in tones(curve).items():
        parts[f"{name}, shown"] = lambda s=settings: tone.shown(range_, *state, s, display)  # type: ignore[misc]
        parts[f"{name}, passed on"] = lambda s=settings: tone.passed_on(change, range_, *state, s, display)  # type: ignore[misc]
    said = tone.shown(range_, *state, Tone(), display)
    passed = tone.passed_on(change, range_, *state, Tone(), display)
    for encoding in Encoding:
        parts[f"code values, {encoding}"] = lambda e=encoding: tone.code_values(passed, said, Display(encoding=e))  # type: ignore[misc]
    show(f"Bounds, {columns}×{rows} tiles", interleaved(parts, rounds), "aces, passed on")


if __name__ == "__main__":
    main()
