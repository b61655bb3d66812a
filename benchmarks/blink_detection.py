"""How well blinks are found in labelled recordings, how far the pupil is off around them, and what the constants do.

Reads the recordings in ../shared/data (see blink_data.py); run as `python -m benchmarks.blink_detection`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks import blink_data
from benchmarks.blink_data import LabelledEye
from entoptic.services.event_scores import Span, compare
from entoptic.tracker_bridge import dropout, dropout_interval, extrapolation, lids, trust
from entoptic.tracker_bridge.dropout import DropoutFilter
from entoptic.tracker_bridge.events import BlinkOffset, BlinkOnset
from entoptic.tracker_bridge.fixed_lag import FixedLagSmoother
from entoptic.tracker_bridge.samples import Eye, EyeState, OneEyeState, PupilSample
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings

DATA = Path(__file__).parents[2] / "shared" / "data"
AROUND_NS = 200_000_000
SEEDS = range(1, 9)
INSTRUCTIONS = ("long blinks", "very long blinks", "slow blinks", "squints")

CONSTANTS: dict[str, tuple[object, ...]] = {
    "MAX_SPEED_PER_S": (trust,),
    "SPEED_WINDOW_NS": (trust, dropout_interval),
    "MIN_CONFIDENCE": (trust, dropout_interval),
    "NOTHING_FOUND": (dropout_interval,),
    "MIN_COVER_NS": (dropout_interval,),
    "SETTLE_NS": (dropout_interval,),
    "HALF_CLOSED_NS": (dropout_interval,),
    "WHOLE_SHARE": (dropout_interval,),
    "IRIS_SPEED_PER_S": (trust, dropout_interval, extrapolation),
    "SIGHTS_OF_A_LID": (dropout_interval,),
    "CLOSED_OPENNESS": (dropout_interval,),
    "ROLL_BACK_NS": (dropout,),
    "DEPTH": (lids,),
    "FALL_NS": (lids,),
    "FADE_S": (extrapolation,),
    "BASELINE_NS": (extrapolation, dropout),
}
"""Each constant and the modules that hold its value."""


def found_blinks(samples: Sequence[PupilSample]) -> list[Span]:
    """The blinks of one eye; one that is not over at the end ends there."""
    eye_filter = DropoutFilter()
    blinks: list[Span] = []
    onset_ns: int | None = None
    for sample in samples:
        for event in eye_filter.step(sample).events:
            if isinstance(event, BlinkOnset):
                onset_ns = event.t_ns
            elif isinstance(event, BlinkOffset):
                blinks.append(Span(event.t_ns - event.duration_ns, event.t_ns, "blink"))
                onset_ns = None
    if onset_ns is not None:
        blinks.append(Span(onset_ns, samples[-1].t_ns, "blink"))
    return blinks


def live_states(eyes: SimulatedEyes) -> Iterator[EyeState]:
    """The states of the live mode, of pupils alone."""
    filters = {eye: DropoutFilter() for eye in Eye}
    pupils = (sample for sample in eyes.samples() if isinstance(sample, PupilSample))
    for sequence, (t_ns, samples) in enumerate(itertools.groupby(pupils, key=lambda sample: sample.t_ns)):
        one: dict[Eye, OneEyeState] = {}
        for sample in samples:
            shown = filters[sample.eye].step(sample)
            one[sample.eye] = OneEyeState(
                phase=shown.phase,
                pupil_diameter_mm=shown.pupil_diameter_mm,
                measured_mm=sample.pupil_diameter_mm,
                confidence=sample.confidence,
                openness=shown.openness,
                gaze=None,
                t_ns=t_ns,
            )
        yield EyeState(sequence, t_ns, one[Eye.RIGHT], one[Eye.LEFT], None)


def recorded_states(eyes: SimulatedEyes) -> Iterator[EyeState]:
    """The states of the recording mode."""
    mode = FixedLagSmoother()
    for state in live_states(eyes):
        yield from mode.step(state)
    yield from mode.flush()


def error_around_blinks_mm(eyes: SimulatedEyes, states: Callable[[SimulatedEyes], Iterator[EyeState]]) -> float:
    """RMS error of the right pupil within 200 ms of a blink, against the true one of that same time."""
    truth = eyes.truth
    near = np.zeros(truth.t_ns.size, dtype=bool)
    for event in truth.events:
        if event.kind == "blink":
            near |= (truth.t_ns >= event.onset_ns - AROUND_NS) & (truth.t_ns <= event.offset_ns + AROUND_NS)
    diameters = np.array([state.right.pupil_diameter_mm for state in states(eyes)], dtype=float)
    return float(np.sqrt(np.mean((diameters - truth.pupil_diameter_mm)[near] ** 2)))


def simulated(seed: int, *, with_openness: bool = True) -> list[LabelledEye]:
    """Both eyes of a simulated person at 200 Hz."""
    eyes = SimulatedEyes(SimulatedSettings(seconds=60.0, seed=seed))
    blinks = [Span(e.onset_ns, e.offset_ns, "blink") for e in eyes.truth.events if e.kind == "blink"]
    samples = [sample for sample in eyes.samples() if isinstance(sample, PupilSample)]
    if not with_openness:
        samples = blink_data.without_openness(samples)
    return [LabelledEye([sample for sample in samples if sample.eye is eye], blinks) for eye in Eye]


def recordings() -> dict[str, list[LabelledEye]]:
    """Every labelled set of eyes, by the name of its row."""
    rows = {f"Lund 2013, rater {rater}; px": blink_data.lund(DATA, rater) for rater in ("MN", "RA")}
    rows["IRF, human; found or not"] = blink_data.irf(DATA)
    dips = blink_data.tobii_dips(DATA)
    rows["Tobii, partial blinks; mm and openness"] = dips
    rows["Tobii, partial blinks; mm"] = [
        LabelledEye(blink_data.without_openness(eye.samples), eye.blinks) for eye in dips
    ]
    for with_openness, what in ((True, "mm and openness"), (False, "mm")):
        for instruction in INSTRUCTIONS:
            eyes = blink_data.tobii(DATA, instruction, with_openness=with_openness)
            rows[f"Tobii, {instruction}; {what}"] = eyes
    rows["Capture 3.6, drawn; mm"] = blink_data.capture(DATA)
    rows["Player, Pupil's detector; confidence"] = blink_data.player(DATA)
    for with_openness, what in ((True, "mm and openness"), (False, "mm")):
        rows[f"Simulated; {what}"] = [eye for seed in SEEDS for eye in simulated(seed, with_openness=with_openness)]
    return rows


def pooled(found: Sequence[list[Span]], labelled: Sequence[list[Span]]) -> str:
    """Cells of a Markdown row: labels, found, precision, recall, F1, median onset and offset errors."""
    scores = [compare(one, other, slack_ns=0) for one, other in zip(found, labelled, strict=True)]
    pairs = sum(len(score.pairs) for score in scores)
    all_found, all_labels = (sum(getattr(score, name) for score in scores) for name in ("found", "labelled"))
    onset, offset = (
        float(np.median(np.concatenate(errors)))
        for errors in ([s.onset_errors_ms for s in scores], [s.offset_errors_ms for s in scores])
    )
    return (
        f"{all_labels} | {all_found} | {pairs / all_found:.2f} | {pairs / all_labels:.2f} "
        f"| {2 * pairs / (all_found + all_labels):.3f} | {onset:+.0f} | {offset:+.0f}"
    )


def f1_of(eyes: Sequence[LabelledEye]) -> float:
    """F1 of all these eyes together."""
    scores = [compare(found_blinks(eye.samples), eye.blinks, slack_ns=0) for eye in eyes]
    return 2 * sum(len(s.pairs) for s in scores) / sum(s.found + s.labelled for s in scores)


def openness_errors() -> str:
    """A Markdown row for each phase: how far the estimated openness of a simulated eye is off the lid's."""
    errors: dict[str, list[float]] = {}
    for seed in SEEDS:
        eyes = SimulatedEyes(SimulatedSettings(seconds=60.0, seed=seed))
        eye_filter = DropoutFilter()
        right = (sample for sample in eyes.samples() if isinstance(sample, PupilSample) and sample.eye is Eye.RIGHT)
        for sample, truth in zip(blink_data.without_openness(list(right)), eyes.truth.openness, strict=True):
            shown = eye_filter.step(sample)
            if shown.openness is not None:
                error = shown.openness - float(truth)
                # Far from blinks it is 1 in truth and estimate: that would only make the figure better.
                names = [shown.phase.value, "blinks as wholes"] if truth < 1.0 else [shown.phase.value]
                for name in names:
                    errors.setdefault(name, []).append(error)
    rows = []
    for name, values in errors.items():
        bias, rms, most = np.mean(values), np.sqrt(np.mean(np.square(values))), np.max(np.abs(values))
        rows.append(f"| {name} | {len(values):,} | {bias:+.3f} | {rms:.3f} | {most:.2f} |")
    return "\n".join(rows)


def main() -> None:
    """Prints four tables in Markdown."""
    rows = recordings()
    print("\n### Blinks found\n")
    print("Matched one to one where they overlap; onset and offset: median of found less labelled, ms.\n")
    print(
        "| recording | labelled | found | precision | recall | F1 | onset | offset |\n|---|--:|--:|--:|--:|--:|--:|--:|"
    )
    for name, eyes in rows.items():
        print(f"| {name} | {pooled([found_blinks(eye.samples) for eye in eyes], [eye.blinks for eye in eyes])} |")
    raters = [[eye.blinks for eye in blink_data.lund(DATA, rater)] for rater in ("MN", "RA")]
    print(f"| Lund 2013, rater MN against rater RA | {pooled(raters[0], raters[1])} |")

    print("\n### Pupil around blinks\n")
    print("RMS error, mm, within 200 ms of a blink; simulated eyes, 200 Hz, noise 0.01 mm, light that changes.\n")
    print("| seed | live mode | recording mode, 50 ms later |\n|---|--:|--:|")
    errors = []
    for seed in SEEDS:
        eyes_of_seed = SimulatedEyes(SimulatedSettings(seconds=60.0, seed=seed))
        errors.append([error_around_blinks_mm(eyes_of_seed, mode) for mode in (live_states, recorded_states)])
        print(f"| {seed} | {errors[-1][0]:.4f} | {errors[-1][1]:.4f} |", flush=True)
    print("| worst | " + " | ".join(f"{worst:.4f}" for worst in np.max(errors, axis=0)) + " |")

    print("\n### Openness told from the pupil\n\nSimulated eyes; estimate less truth.\n")
    print("| phase | samples | bias | RMS | largest |\n|---|--:|--:|--:|--:|")
    print(openness_errors())

    print("\n### What the constants do\n\nF1 and RMS error with each constant halved / doubled.\n")
    human = [eye for name, eyes in rows.items() if "rater" in name or "human" in name for eye in eyes]
    lids = [eye for name, eyes in rows.items() if "Tobii" in name and "openness" in name for eye in eyes]
    pupils = [eye for name, eyes in rows.items() if "Tobii" in name and "openness" not in name for eye in eyes]
    drawn = rows["Capture 3.6, drawn; mm"]
    some = [SimulatedEyes(SimulatedSettings(seconds=60.0, seed=seed)) for seed in (1, 5)]

    def figures() -> list[str]:
        f1 = [f"{f1_of(eyes):.2f}" for eyes in (human, lids, pupils, drawn)]
        rms = [
            f"{max(error_around_blinks_mm(eyes, mode) for eyes in some):.3f}" for mode in (live_states, recorded_states)
        ]
        return f1 + rms

    print("| constant | human labels | Tobii, openness | Tobii, mm | Capture | live mm | recording mm |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    print("| as it is | " + " | ".join(figures()) + " |", flush=True)
    for name, modules in CONSTANTS.items():
        value = getattr(modules[0], name)
        halved_doubled = []
        for factor in (0.5, 2.0):
            changed = type(value)(
                min(value * factor, 0.95) if name in ("MIN_CONFIDENCE", "WHOLE_SHARE") else value * factor
            )
            for module in modules:
                setattr(module, name, changed)
            halved_doubled.append(figures())
        for module in modules:
            setattr(module, name, value)
        cells = [f"{half} / {double}" for half, double in zip(*halved_doubled, strict=True)]
        print(f"| {name} {value:g} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
