"""How near the simulated pupil's light reflex comes to measured ones: a table, and docs/light-reflex.png.

The measured responses are means of 1 s flashes of five powers in the dark (PLR-3000 pupillometer, published with
PyPlr: Martin et al. 2022). Every power was a session of its own, with its own diameter before the flash; the simulated
pupil starts there because it is given the background light at which its steady size is that one. Nothing else differs
between the five: one observer, one field, one factor from power to luminance.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import brentq

from entoptic.tracker_bridge.sources.simulated.pupil import STEP_S, light_reflex_mm, watson_yellott_mm

Floats = NDArray[np.float64]

ROOT = Path(__file__).parents[1]
MEASURED = ROOT.parent / "shared/data/plr/plr3000_intensity_series_mean_mm.csv"
PLOT = ROOT / "docs/light-reflex.png"
POWERS_UW = (1, 10, 50, 121, 180)
FLASH_S = 1.0
CD_M2_PER_UW = 3.2
"""One for all powers, fitted with the reflex: no luminance was published."""
FIELD_DEG2, AGE_YEARS = 900.0, 30.0
"""Engineering choice: neither was published; the field only scales CD_M2_PER_UW."""
ANSWERED = 0.01
"""The share of its diameter by which a pupil must have shrunk to have answered. Engineering choice: above the noise of
the means, ± 0.5 %, and early in the constriction."""
UNANSWERED_S = 0.2
"""No pupil has answered by then, and the mean of this long before the flash and after it is what it answers from."""


class Response(NamedTuple):
    """What a pupil did after a flash."""

    latency_s: float
    """When it was first ANSWERED smaller than around the flash, between two samples."""
    baseline_mm: float
    """The mean of the second before the flash."""
    minimum_mm: float
    """The smallest sample."""
    minimum_s: float
    """When that was."""

    @property
    def amplitude_mm(self) -> float:
        """How far it constricted."""
        return self.baseline_mm - self.minimum_mm


def response(t_s: Floats, pupil_diameters_mm: Floats) -> Response:
    """What is read off a trace, measured or simulated, whose times run from the flash on."""
    threshold = (1.0 - ANSWERED) * pupil_diameters_mm[np.abs(t_s) <= UNANSWERED_S].mean()
    first = int(np.argmax((t_s > 0.0) & (pupil_diameters_mm < threshold)))
    latency = np.interp(threshold, pupil_diameters_mm[[first, first - 1]], t_s[[first, first - 1]])
    smallest = int(np.argmin(pupil_diameters_mm))
    return Response(
        latency_s=float(latency),
        baseline_mm=float(pupil_diameters_mm[t_s < 0.0].mean()),
        minimum_mm=float(pupil_diameters_mm[smallest]),
        minimum_s=float(t_s[smallest]),
    )


def measured(path: Path) -> tuple[Floats, dict[int, Floats]]:
    """The times of all traces, in s from the flash on, and the diameters in mm by power in µW."""
    table = np.genfromtxt(path, delimiter=",", names=True)
    return table["onset_s"], {power_uw: table[f"pupil_mm_{power_uw}uW"] for power_uw in POWERS_UW}


def simulated(t_s: Floats, power_uw: float, baseline_mm: float) -> Floats:
    """The simulated diameters at these times after a flash, for a pupil as wide as this before it."""
    background = brentq(
        lambda luminance: watson_yellott_mm(luminance, FIELD_DEG2, AGE_YEARS) - baseline_mm, 1e-6, 1e6, xtol=1e-9
    )
    before_s = -float(t_s[0])
    steps = (
        (0.0, background),
        (before_s, background + CD_M2_PER_UW * power_uw),
        (before_s + FLASH_S, background),
    )
    diameters = light_reflex_mm(float(t_s[-1]) + before_s, steps, FIELD_DEG2, AGE_YEARS)
    return np.interp(t_s + before_s, np.arange(diameters.size) * STEP_S, diameters)


def plot(path: Path, t_s: Floats, traces: dict[int, tuple[Floats, Floats]]) -> None:
    """Draws the measured and simulated diameters of each power."""
    figure = Figure(figsize=(10.0, 3.6), dpi=100, layout="constrained")
    panels = figure.subplots(1, len(traces), sharex=True, sharey=True)
    for nth, (axes, (power_uw, (seen, model))) in enumerate(zip(panels, traces.items(), strict=True)):
        axes.axvspan(0.0, FLASH_S, color="#fdf0c4", lw=0, label="flash")
        axes.plot(t_s, model, color=f"C{nth}", lw=2.6, alpha=0.6, label=f"{power_uw} µW, simulated")
        axes.plot(t_s, seen, color="black", lw=0.9, label="measured")
        axes.legend(loc="lower right", fontsize=7, frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(visible=True, lw=0.3)
        axes.margins(x=0)
    panels[0].set(ylabel="pupil diameter / mm", ylim=(2.0, 6.5), xticks=range(0, 9, 2))
    figure.supxlabel("time since the flash / s", fontsize=10)
    figure.savefig(path)


def main() -> None:
    """Prints a Markdown table and draws the plot."""
    if not MEASURED.exists():
        print(f"\nNo measured light reflexes: {MEASURED} is not here.")
        return
    t_s, by_power = measured(MEASURED)
    traces = {}
    print(
        "\n### Light reflex, measured / simulated\n\n"
        "| flash | latency, s | before, mm | minimum, mm | constriction, mm | time of minimum, s "
        "| error of latency, minimum, constriction, time |\n|---:|---|---|---|---|---|---|"
    )
    for power_uw, seen_mm in by_power.items():
        seen = response(t_s, seen_mm)
        model_mm = simulated(t_s, power_uw, seen.baseline_mm)
        model = response(t_s, model_mm)
        traces[power_uw] = (seen_mm, model_mm)
        pairs = (
            (seen.latency_s, model.latency_s),
            (seen.minimum_mm, model.minimum_mm),
            (seen.amplitude_mm, model.amplitude_mm),
            (seen.minimum_s, model.minimum_s),
        )
        latency, minimum, amplitude, time = (f"{a:.2f} / {b:.2f}" for a, b in pairs)
        errors = ", ".join(f"{b / a - 1.0:+.1%}" for a, b in pairs)
        before = f"{seen.baseline_mm:.2f} / {model.baseline_mm:.2f}"
        print(f"| {power_uw} µW | {latency} | {before} | {minimum} | {amplitude} | {time} | {errors} |")
    plot(PLOT, t_s, traces)


if __name__ == "__main__":
    main()
