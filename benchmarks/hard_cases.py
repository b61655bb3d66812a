"""What pfstools' operators make of the frames in tests/hard_cases, beside what comes out here: docs/hard-cases.md.

Measures no time: run by its own name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks import pfstools
from benchmarks.pfstools import Image
from entoptic.pipeline import Effects, EyePose, Frame, FrameError, Observer, perceive
from entoptic.pipeline.effects.adaptation import Adaptation

SIZE = (64, 64)
FPS = 24
PATTANAIK, REINHARD = pfstools.OPERATORS
IN_TIME = f"{PATTANAIK} -t --fps {FPS}", f"{REINHARD} --temporal-coherent"
OBSERVER = Observer(particles=50, gratings=20)
AS_SHIPPED, ROBUST = Effects(), Effects(adaptation=Adaptation(robust=True))

Way = Callable[[Sequence[Image]], list[Image]]


def textured(mean: float) -> Image:
    return (mean * np.random.default_rng(0).uniform(0.35, 1.65, (*SIZE, 1)) * np.ones(3)).astype(np.float32)


def flat(value: float) -> Image:
    return np.full((*SIZE, 3), value, np.float32)


def with_pixel(rgb: Image, value: float) -> Image:
    changed = rgb.copy()
    changed[10, 10] = value
    return changed


def here(frames: Sequence[Image], effects: Effects = AS_SHIPPED) -> list[Image]:
    """What the display shows, linear, as the operators' results are; none from a frame that is refused on."""
    made: list[Image] = []
    state = None
    for rgb in frames:
        try:
            perceived = perceive(
                Frame.from_rgb(rgb, 60.0),
                EyePose(pupil_diameter_mm=4.0),
                observer=OBSERVER,
                state=state,
                dt_s=1 / FPS,
                effects=effects,
            )
        except FrameError:
            return made
        state = perceived.state
        made.append(np.asarray(perceived.linear)[0].transpose(1, 2, 0))
    return made


def by(command: str) -> Way:
    return lambda frames: pfstools.shown(command, frames)


def described(images: Sequence[Image], clear: Image | None = None) -> str:
    """What came out: how much of it is no number, its range, and how many pixels differ from a frame without fault."""
    if not images:
        return "nothing: it ended with an error"
    image = images[-1]
    bad = int((~np.isfinite(image)).any(axis=2).sum())
    if bad == image.shape[0] * image.shape[1]:
        return "NaN everywhere"
    low, high = float(np.nanmin(image)), float(np.nanmax(image))
    alike = high - low <= 1e-5
    words = (
        "black everywhere" if alike and high == 0 else f"{high:.3g} everywhere" if alike else f"{low:.2g}–{high:.2g}"
    )
    if bad:
        words += f", NaN in {bad} pixels"
    if clear is not None and clear.shape == image.shape:
        apart = ~(np.abs(np.clip(image, 0, 1) - np.clip(clear, 0, 1)) * 255 <= 0.5)
        words += f"; {int(apart.any(axis=2).sum())} pixels changed"
    return words


def course(images: Sequence[Image], first: int, count: int) -> str:
    """The median of each of some frames."""
    return " ".join(f"{float(np.median(image)):.2g}" for image in images[first : first + count])


def main() -> None:
    """Prints the tables."""
    if absent := pfstools.missing():
        print(f"\nNo comparison with pfstools: {', '.join(absent)} not installed (Debian: pfstools).")
        return
    print(f"\n### One frame ({pfstools.version()})\n")
    ways: dict[str, Way] = {"here": here, PATTANAIK: by(PATTANAIK), REINHARD: by(REINHARD)}
    print(f"| | {' | '.join(ways)} |\n|---|---|---|---|")
    base = textured(1.0)
    sun = with_pixel(flat(1e-6), 1e9)
    cases = {
        "a pixel of −1": with_pixel(base, -1),
        "a pixel of NaN": with_pixel(base, np.nan),
        "a pixel of infinity": with_pixel(base, np.inf),
        "a pixel of 0": with_pixel(base, 0),
        "black": flat(0),
        "all 1e-42 (denormal)": flat(1e-42),
        "all 0.01": flat(0.01),
        "all 0.03": flat(0.03),
        "all 1": flat(1),
        "all 1000": flat(1000),
        "1e9 beside 1e-6": sun,
    }
    clear = {name: way([base])[0] for name, way in ways.items()}
    for name, frame in cases.items():
        compare = name.startswith("a pixel")
        cells = [described(way([frame]), clear[key] if compare else None) for key, way in ways.items()]
        print(f"| {name} | {' | '.join(cells)} |")
    print(f"\n### In time, {FPS} frames a second: the median of each frame\n")
    ways = {"here": here} | {command: by(command) for command in IN_TIME}
    step = [textured(0.01)] * 12 + [textured(1000.0)] * 36
    lamp, off = textured(0.05), textured(0.05)
    lamp[28:30, 28:30] = 1e4
    blink = [lamp if k / FPS * 5 % 1 < 0.5 else off for k in range(48)]
    still = [textured(0.01)] * 240
    for name, way in ways.items():
        images = way(step)
        print(f"- step from 0.01 to 1000, {name}: {course(images, 10, 10)} … {course(images, 42, 6)}")
    for name, way in ways.items():
        images = way(still)
        print(f"- nothing changes, {name}: {course(images, 0, 6)} … {course(images, 234, 6)}")
    for name, way in {"here": here, "here, adaptation robust": lambda frames: here(frames, ROBUST), **ways}.items():
        print(f"- a light of 1e4 blinking at 5 Hz, {name}: {course(way(blink), 36, 12)}")
    for name, way in ways.items():
        images = way([textured(5.0)] * 3 + [textured(5.0)[:33, :41]] * 3)
        sizes = " ".join(f"{image.shape[1]}×{image.shape[0]}" for image in images)
        print(f"- another size after three frames, {name}: {sizes}, {course(images, 0, 6)}")


if __name__ == "__main__":
    main()
