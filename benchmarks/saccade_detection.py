"""How well saccades and microsaccades are found: simulated eyes, whose truth is known, and people's labels."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Iterable, Sequence

import numpy as np

from benchmarks import labelled_gaze
from benchmarks.labelled_gaze import Labelled
from entoptic.services.detect import lost_after
from entoptic.services.event_scores import Scores, Span, compare, error_text
from entoptic.tracker_bridge.dropout import DropoutFilter
from entoptic.tracker_bridge.events import SaccadeOffset, SaccadeOnset
from entoptic.tracker_bridge.microsaccades import COVERED, MIN_CONFIDENCE, SaccadeDetector, SaccadeEvent
from entoptic.tracker_bridge.oracles import engbert_kliegl
from entoptic.tracker_bridge.saccade_of_one_eye import SaccadeSettings
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.simulated.truth import TruthEvent

FROM_NS = 600_000_000
"""Before this the detector still learns the noise."""
ANY_EYE = (Eye.RIGHT, Eye.LEFT, None)


@functools.lru_cache(maxsize=5)
def simulated(
    seed: int, rate_hz: float, noise_deg: float, blinks: float
) -> tuple[list[PupilSample | GazeSample], list[TruthEvent]]:
    settings = SimulatedSettings(
        seconds=60.0, rate_hz=rate_hz, seed=seed, noise_deg=noise_deg, blinks_per_minute=blinks
    )
    eyes = SimulatedEyes(settings)
    samples = list(eyes.samples())
    if not blinks:
        samples = [sample for sample in samples if isinstance(sample, GazeSample)]
    return samples, [e for e in eyes.truth.events if e.kind != "blink" and e.onset_ns > FROM_NS]


def found(
    samples: Iterable[GazeSample | PupilSample],
    settings: SaccadeSettings | None = None,
    *,
    eyes: Sequence[Eye | None] = ANY_EYE,
    pupils: bool = True,
) -> list[tuple[SaccadeOnset, SaccadeOffset]]:
    """What the online detector makes of them, with the pupils' phases or without."""
    detector = SaccadeDetector(settings)
    filters = {eye: DropoutFilter() for eye in Eye}
    events: list[SaccadeEvent] = []
    for sample in samples:
        if isinstance(sample, PupilSample):
            if pupils and filters[sample.eye].step(sample).phase in COVERED:
                events.extend(detector.blind(sample.t_ns, sample.eye))
        elif sample.eye in eyes:
            events.extend(detector.step(sample))
    onsets = [event for event in events if isinstance(event, SaccadeOnset)]
    offsets = [event for event in events if isinstance(event, SaccadeOffset)]
    return [pair for pair in zip(onsets, offsets, strict=False) if pair[0].onset_ns > FROM_NS]


def spans(pairs: Iterable[tuple[SaccadeOnset, SaccadeOffset]]) -> list[Span]:
    return [Span(offset.onset_ns, offset.offset_ns, offset.kind) for _, offset in pairs]


@dataclasses.dataclass
class Tally:
    """Several recordings together."""

    truth: list[TruthEvent]
    hits: list[tuple[TruthEvent, SaccadeOnset, SaccadeOffset]]
    false_alarms: int
    minutes: float

    def recall(self, kind: str, low: float = 0.0, high: float = 99.0) -> float:
        def counts(event: TruthEvent) -> bool:
            return event.kind == kind and low <= (event.amplitude_deg or 0.0) < high

        return sum(counts(event) for event, *_ in self.hits) / max(sum(map(counts, self.truth)), 1)

    def latency_ms(self) -> np.ndarray:
        return np.array([(onset.t_ns - event.onset_ns) * 1e-6 for event, onset, _ in self.hits])

    def onset_ms(self) -> np.ndarray:
        return np.array([(onset.onset_ns - event.onset_ns) * 1e-6 for event, onset, _ in self.hits])

    def offset_ms(self) -> np.ndarray:
        return np.array([(offset.offset_ns - event.offset_ns) * 1e-6 for event, _, offset in self.hits])


@functools.lru_cache(maxsize=8)
def tally(
    rate_hz: float,
    noise_deg: float,
    settings: SaccadeSettings | None = None,
    *,
    seeds: tuple[int, ...] = (1, 2, 3, 4, 5),
    blinks: float = 15.0,
    eyes: tuple[Eye | None, ...] = ANY_EYE,
    pupils: bool = True,
) -> Tally:
    whole = Tally([], [], 0, 0.0)
    for seed in seeds:
        samples, truth = simulated(seed, rate_hz, noise_deg, blinks)
        pairs = found(samples, settings, eyes=eyes, pupils=pupils)
        scores = compare(spans(pairs), [Span(event.onset_ns, event.offset_ns) for event in truth])
        whole.truth += truth
        whole.hits += [(truth[j], *pairs[i]) for i, j in scores.pairs]
        whole.false_alarms += scores.found - len(scores.pairs)
        whole.minutes += 1.0
    return whole


def head(*columns: str) -> None:
    print(f"| {' | '.join(columns)} |\n|---|{'---:|' * (len(columns) - 1)}")


def by_rate() -> None:
    print("\n### Online, simulated eyes, 5 × 60 s (2 × 60 s above 200 Hz), 15 blinks/min: by rate and noise\n")
    head(
        "", "recall, microsaccades", "recall, saccades", "false alarms/min", "latency ms, median (90 %)",
        "onset error ms, bias / median size / 90 %", "offset error ms",
    )  # fmt: skip
    for rate, noise in [(r, 0.02) for r in (60, 120, 200, 500, 1000)] + [(200, 0.01), (200, 0.03)]:
        t = tally(rate, noise, seeds=(1, 2, 3, 4, 5) if rate <= 200 else (1, 2))
        latency = t.latency_ms()
        print(
            f"| {rate} Hz, {noise:g}° | {t.recall('microsaccade'):.3f} | {t.recall('saccade'):.3f} "
            f"| {t.false_alarms / t.minutes:.1f} | {np.median(latency):.0f} ({np.percentile(latency, 90):.0f}) "
            f"| {error_text(t.onset_ms())} | {error_text(t.offset_ms())} |",
            flush=True,
        )


def by_amplitude() -> None:
    print("\n### Online, 200 Hz: by amplitude (log-uniform 0.15–1°; saccades 1.5–20°)\n")
    head(
        "amplitude", "recall at 0.01° / 0.02° / 0.03°", "peak velocity, found/true", "amplitude error, median size",
        "onset error ms",
    )  # fmt: skip
    tallies = [tally(200, noise) for noise in (0.01, 0.02, 0.03)]
    bounds = (0.15, 0.2, 0.3, 0.5, 1.01, 5.0, 21.0)
    for low, high in itertools.pairwise(bounds):
        kind = "microsaccade" if high < 2 else "saccade"
        inside = [hit for hit in tallies[1].hits if low <= (hit[0].amplitude_deg or 0.0) < high]
        peak = np.median([o.peak_velocity_deg_s / (e.peak_velocity_deg_s or 1.0) for e, _, o in inside])
        off = np.median([abs(o.amplitude_deg - (e.amplitude_deg or 0.0)) for e, _, o in inside])
        onset = np.array([(o.onset_ns - e.onset_ns) * 1e-6 for e, o, _ in inside])
        recalls = " / ".join(f"{t.recall(kind, low, high):.3f}" for t in tallies)
        print(f"| {low:g}–{high:.2g}° ({len(inside)}) | {recalls} | {peak:.2f} | {off:.3f}° | {error_text(onset)} |")


def by_what_is_seen() -> None:
    print("\n### Online, 200 Hz, 0.02°: what the source gives, and what the lids do (3 × 60 s, 15 blinks/min)\n")
    head("", "recall, microsaccades", "false alarms/min", "latency ms, median (90 %)")
    cases: dict[str, tuple[tuple[Eye | None, ...], bool, int]] = {
        "both eyes and their pupils": (ANY_EYE, True, 10),
        "one eye and its pupil": ((Eye.RIGHT,), True, 10),
        "both eyes' common direction, and pupils": ((None,), True, 10),
        "both eyes and their pupils, no wait downwards": (ANY_EYE, True, 0),
        "directions alone, no wait downwards": (ANY_EYE, False, 0),
        "directions alone": (ANY_EYE, False, 10),
        "directions alone, 20 ms wait": (ANY_EYE, False, 20),
    }
    for name, (eyes, pupils, wait_ms) in cases.items():
        settings = SaccadeSettings(lid_wait_ns=wait_ms * 1_000_000)
        t = tally(200, 0.02, settings, seeds=(1, 2, 3), eyes=eyes, pupils=pupils)
        latency = t.latency_ms()
        print(
            f"| {name} | {t.recall('microsaccade'):.3f} | {t.false_alarms / t.minutes:.1f} "
            f"| {np.median(latency):.0f} ({np.percentile(latency, 90):.0f}) |",
            flush=True,
        )


def sensitivity() -> None:
    print("\n### Sensitivity: recall of microsaccades, false alarms/min, median latency ms (2 × 60 s without blinks)\n")
    columns = [(120, 0.01), (120, 0.03), (200, 0.01), (200, 0.03)]
    head("λ, samples, floor of σ °/s", *(f"{rate} Hz, {noise}°" for rate, noise in columns))
    for factor, samples, floor in [
        (6, 2, 0.5), (4, 2, 0.5), (5, 2, 0.5), (8, 2, 0.5), (6, 3, 0.5),
        (6, 2, 0.0), (6, 2, 0.25), (6, 2, 1.0), (6, 2, 2.0),
    ]:  # fmt: skip
        cells = []
        for rate, noise in columns:
            run_ns = round((samples - 1) * 1e9 / rate)
            t = tally(rate, noise, SaccadeSettings(factor, run_ns, floor), seeds=(1, 2), blinks=0.0)
            cells.append(
                f"{t.recall('microsaccade'):.2f}, {t.false_alarms / t.minutes:.1f}, {np.median(t.latency_ms()):.0f}"
            )
        print(f"| {factor}, {samples}, {floor:g} | {' | '.join(cells)} |", flush=True)


def window() -> None:
    print("\n### Half window at high rates: the same figures, 0.02° of noise\n")
    columns = (500, 1000)
    head("half window", *(f"{rate} Hz" for rate in columns))
    for half_ms in (2, 4, 6, 8, 10):
        cells = []
        for rate in columns:
            settings = SaccadeSettings(half_window_ns=half_ms * 1_000_000)
            t = tally(rate, 0.02, settings, seeds=(1,), blinks=0.0)
            cells.append(
                f"{t.recall('microsaccade'):.2f}, {t.false_alarms / t.minutes:.1f}, {np.median(t.latency_ms()):.0f}"
            )
        print(f"| {half_ms} ms | {' | '.join(cells)} |", flush=True)


def offline(recording: Labelled) -> list[Span]:
    """The toolbox's method, λ 5 and 3 samples, one eye; nothing within 100 ms of what is not seen."""
    seen = np.array([sample.confidence > 0.5 for sample in recording.gaze])
    positions = np.array([[sample.azimuth_deg, sample.elevation_deg] for sample in recording.gaze])
    at = np.arange(len(positions))
    positions = np.stack([np.interp(at, at[seen], axis[seen]) for axis in positions.T], axis=1)
    margin = round(0.1 * recording.rate_hz)
    near = np.convolve(~seen, np.ones(2 * margin + 1), "same") > 0.5
    sigma = engbert_kliegl.noise_deg_s(engbert_kliegl.velocities_deg_s(positions, recording.rate_hz)[~near])
    all_of_them = engbert_kliegl.movements(positions, recording.rate_hz, sigma_deg_s=sigma)
    kept = engbert_kliegl.without_overshoots(all_of_them, recording.rate_hz)
    t_ns = [sample.t_ns for sample in recording.gaze]
    return [Span(t_ns[m.first], t_ns[m.last]) for m in kept if not near[m.first : m.last + 1].any()]


def _later(some: Iterable[Span]) -> list[Span]:
    return [span for span in some if span.onset_ns > FROM_NS]


def _row(name: str, all_scores: Sequence[Scores]) -> None:
    whole = Scores(
        found=sum(s.found for s in all_scores),
        labelled=sum(s.labelled for s in all_scores),
        pairs=tuple(itertools.chain.from_iterable(s.pairs for s in all_scores)),
        onset_errors_ms=np.concatenate([s.onset_errors_ms for s in all_scores]),
        offset_errors_ms=np.concatenate([s.offset_errors_ms for s in all_scores]),
    )
    print(
        f"| {name} | {whole.labelled} | {whole.precision:.3f} | {whole.recall:.3f} | {whole.f1:.3f} "
        f"| {error_text(whole.onset_errors_ms)} | {error_text(whole.offset_errors_ms)} |",
        flush=True,
    )


def against_people() -> None:
    print("\n### Saccades that people labelled\n")
    head("", "labelled", "precision", "recall", "F1", "onset error ms, bias / median size / 90 %", "offset error ms")
    for recording in labelled_gaze.irf():
        (labels,) = recording.labels.values()
        labels = _later(labels)
        for nth in (1, 2, 5, 8):
            pairs = found(labelled_gaze.every(recording, nth))
            _row(f"{recording.name}: online, {1000 / nth:g} Hz", [compare(spans(pairs), labels)])
            lost_ns = [sample.t_ns for sample in recording.gaze if sample.confidence < MIN_CONFIDENCE]
            clear = [pair for pair in pairs if not lost_after(lost_ns, pair[1])]
            if len(clear) < len(pairs):
                _row(f"{recording.name}: the same, without what ends at a blink", [compare(spans(clear), labels)])
        _row(f"{recording.name}: offline, 1000 Hz", [compare(_later(offline(recording)), labels)])
    for kind in ("img", "dots"):
        recordings = list(labelled_gaze.lund(kind))
        if not recordings:
            continue
        online = [spans(found(recording.gaze)) for recording in recordings]
        plain = [_later(offline(recording)) for recording in recordings]
        of = {rater: [_later(recording.labels[rater]) for recording in recordings] for rater in ("MN", "RA")}
        name = f"lund2013 {kind}"
        _row(f"{name}: rater RA against MN", [compare(a, b) for a, b in zip(of["RA"], of["MN"], strict=True)])
        for rater, labels_of in of.items():
            _row(f"{name}: online against {rater}", [compare(a, b) for a, b in zip(online, labels_of, strict=True)])
            _row(f"{name}: offline against {rater}", [compare(a, b) for a, b in zip(plain, labels_of, strict=True)])


def main() -> None:
    """Prints the tables."""
    by_rate()
    by_amplitude()
    by_what_is_seen()
    sensitivity()
    window()
    if labelled_gaze.DATA.exists():
        against_people()
    else:
        print(f"\nNo labelled recordings: {labelled_gaze.DATA} is not here.")


if __name__ == "__main__":
    main()
