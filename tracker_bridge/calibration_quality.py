"""What a run of the black and white screens says about each eye, and whether to believe it.

Diameters go through the filter that the bridge uses live, so that lids and lost pupils count as what they are. The
filter shows millimetres. Where a tracker gives pixels alone, an eye's pixels are made provisional millimetres by taking
its pupil before the white screen for 2.5 mm wide (pupil_map.py says why). All limits below hold in these millimetres;
what is reported is in the tracker's own unit.
"""

from __future__ import annotations

import dataclasses
import enum
import itertools
import math
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.calibration import Protocol, Screen, ShownScreen, Stage, Statistic
from entoptic.tracker_bridge.dropout import DropoutFilter
from entoptic.tracker_bridge.pupil_map import WHITE_PX_AS_MM, Unit, in_provisional_mm
from entoptic.tracker_bridge.samples import NS_PER_S, Eye, Phase, PupilSample
from entoptic.tracker_bridge.trust import MIN_CONFIDENCE

Floats = NDArray[np.float64]

MIN_VALID_SHARE, MIN_VALID_S = 0.6, 1.5
"""Of a window. Engineering choice: a median of less hangs on a few blinks."""
MAX_SLOPE_MM_S = 0.1
"""A pupil that still moves faster has not arrived. Engineering choice: 0.4 mm in a window, above hippus."""
MAX_WHITES_MM = 0.3
"""Between the white before and the white after. Engineering choice: 1.5 times the 95th percentile of hippus alone."""
MIN_SPAN_MM = 1.0
"""Between white and black. Engineering choice: healthy pupils span 3 to 5 mm, those of old age 1.5 and more."""
MAX_EYES_MM = 1.0
"""Between the eyes' diameters, and between their spans. Pupils of healthy people differ by 0.4 mm in a fifth of them
and rarely by more than 1 mm (Lam, Thompson & Corbett 1987, Am. J. Ophthalmol. 104, 69)."""
_SLOPE_BLOCK_S = 0.1


class Failure(enum.StrEnum):
    """Why a calibration gives no result."""

    TOO_FEW_SAMPLES = "too few samples"
    NO_SPAN = "no span"
    INVERTED = "inverted"
    DRIFTING = "drifting"
    EYES_DISAGREE = "eyes disagree"
    NOT_SHOWN = "stimulus not shown"
    ABORTED = "aborted"


REMEDIES = {
    Failure.TOO_FEW_SAMPLES: "look whether the tracker sees the pupil in the dark too, keep the eyes open, repeat; or "
    "leave this eye out with --eyes",
    Failure.NO_SPAN: "let the display fill the view, turn its brightness up and the room's light down, repeat",
    Failure.INVERTED: "look whether the display shows white as white, and black as black, and answers in time; repeat",
    Failure.DRIFTING: "sit for a minute in the room's light, look at the cross all the time, repeat; or give the "
    "screens longer with --white-seconds and --black-seconds",
    Failure.EYES_DISAGREE: "look whether both eyes see the display and both eye cameras are in focus, repeat; or "
    "choose one eye with --eyes",
    Failure.NOT_SHOWN: "keep the page open, in front and awake (or the display program connected), repeat",
    Failure.ABORTED: "nothing was changed; start again when ready",
}


class Problem(msgspec.Struct, frozen=True):
    """One thing that is wrong with a run."""

    failure: Failure
    eye: Eye | None
    """None where it is not an eye's."""
    detail: str
    """The figures, for a person."""

    @property
    def remedy(self) -> str:
        """What to do."""
        return REMEDIES[self.failure]

    @property
    def name(self) -> str:
        """What is wrong, and with which eye."""
        return self.failure.value if self.eye is None else f"{self.failure.value}, {self.eye.name.lower()} eye"


@dataclasses.dataclass(frozen=True)
class Trace:
    """One eye's samples, in the order of their time."""

    eye: Eye
    unit: Unit
    native_per_mm: float
    """How much of the unit is one (provisional) millimetre."""
    t_ns: NDArray[np.int64]
    measured: Floats
    """As the tracker gave it; NaN where it gave none."""
    tracked: Floats
    """What the filter trusts, in the same unit; NaN where it does not."""
    period_s: float
    """Between two samples, usually."""


@dataclasses.dataclass(frozen=True)
class Window:
    """The measured end of one screen, of one eye."""

    screen: Screen
    from_ns: int
    to_ns: int
    value: float
    """In the trace's unit; NaN without valid samples."""
    valid_share: float
    valid_s: float
    slope_mm_s: float
    """In (provisional) mm; NaN without valid samples."""


@dataclasses.dataclass(frozen=True)
class EyeResult:
    """One eye's pupil before white and before black, in its trace's unit."""

    trace: Trace
    windows: tuple[Window, ...]

    def of(self, screen: Screen) -> float:
        """Its diameter before a screen, all windows of which weigh the same."""
        return float(np.mean([window.value for window in self.windows if window.screen is screen]))

    def mm(self, screen: Screen) -> float:
        """The same in (provisional) millimetres."""
        return self.of(screen) / self.trace.native_per_mm

    @property
    def span_mm(self) -> float:
        """How much wider it is before black, in (provisional) millimetres."""
        return self.mm(Screen.BLACK) - self.mm(Screen.WHITE)


@dataclasses.dataclass(frozen=True)
class Analysis:
    """A whole run: believable if it has no problems."""

    eyes: dict[Eye, EyeResult]
    problems: tuple[Problem, ...]


def analyse(
    samples: Iterable[PupilSample],
    screens: Sequence[ShownScreen],
    protocol: Protocol,
    stage: Stage = Stage.FINISHED,
    eyes: Sequence[Eye] = tuple(Eye),
) -> Analysis:
    """What a run that ended in `stage` measured of `eyes`. An eye without any sample is taken for not tracked."""
    by_eye: dict[Eye, list[PupilSample]] = {eye: [] for eye in eyes}
    for sample in samples:
        if sample.eye in by_eye:
            by_eye[sample.eye].append(sample)
    results = {eye: _measure(trace_of(own, screens), screens, protocol.statistic) for eye, own in by_eye.items() if own}
    if stage is Stage.ABORTED:
        return Analysis(results, (Problem(Failure.ABORTED, None, "the run was stopped before its end"),))
    if stage is not Stage.FINISHED:
        detail = f"the display did not say that screen {len(screens) + 1} of {len(protocol.steps)} was shown"
        return Analysis(results, (Problem(Failure.NOT_SHOWN, None, detail),))
    if not results:
        names = " and the ".join(eye.name.lower() for eye in eyes)
        return Analysis({}, (Problem(Failure.TOO_FEW_SAMPLES, None, f"no sample of the {names} eye came"),))
    problems = [problem for result in results.values() for problem in _problems(result, protocol)]
    if not problems and len(results) == len(Eye):
        problems += _disagreement(*results.values())
    return Analysis(results, tuple(problems))


def trace_of(samples: Sequence[PupilSample], screens: Sequence[ShownScreen]) -> Trace:
    """One eye's samples through the filter; what came late, twice or backwards is left out."""
    ordered: list[PupilSample] = []
    for sample in samples:
        if not ordered or sample.t_ns > ordered[-1].t_ns:
            ordered.append(sample)
    unit: Unit = "mm" if any(sample.pupil_diameter_mm is not None for sample in ordered) else "px"
    scale = 1.0 if unit == "mm" else _px_per_mm(ordered, screens)
    pupil = DropoutFilter()
    measured = np.full(len(ordered), math.nan)
    tracked = np.full(len(ordered), math.nan)
    for k, sample in enumerate(ordered):
        native = sample.pupil_diameter_mm if unit == "mm" else sample.diameter_px
        if native is not None:
            measured[k] = native
        if unit == "px":
            sample = in_provisional_mm(sample, scale)
        shown = pupil.step(sample)
        if shown.phase is Phase.TRACKING and shown.pupil_diameter_mm is not None:
            tracked[k] = shown.pupil_diameter_mm * scale
    t_ns = np.array([sample.t_ns for sample in ordered], dtype=np.int64)
    period_s = float(np.median(np.diff(t_ns))) / NS_PER_S if t_ns.size > 1 else 0.0
    return Trace(ordered[0].eye, unit, scale, t_ns, measured, tracked, period_s)


def _px_per_mm(samples: Sequence[PupilSample], screens: Sequence[ShownScreen]) -> float:
    windows = [screen.window_ns for screen in screens if screen.screen is Screen.WHITE]
    white = [
        sample.diameter_px
        for sample in samples
        if sample.diameter_px is not None
        and sample.diameter_px > 0
        and sample.confidence >= MIN_CONFIDENCE
        and any(start <= sample.t_ns < end for start, end in windows)
    ]
    return float(np.median(white)) / WHITE_PX_AS_MM if white else 1.0


def _measure(trace: Trace, screens: Sequence[ShownScreen], statistic: Statistic) -> EyeResult:
    return EyeResult(trace, tuple(_window(trace, screen, statistic) for screen in screens))


def _window(trace: Trace, screen: ShownScreen, statistic: Statistic) -> Window:
    start_ns, end_ns = screen.window_ns
    inside = slice(*np.searchsorted(trace.t_ns, (start_ns, end_ns)))
    t_s = (trace.t_ns[inside] - start_ns) / NS_PER_S
    valid = np.isfinite(trace.tracked[inside])
    diameters = trace.tracked[inside][valid]
    # By time and not by count, since a tracker that falls silent sends no invalid samples either.
    valid_s = diameters.size * trace.period_s
    share = min(valid_s * NS_PER_S / (end_ns - start_ns), 1.0)
    if diameters.size < 2:
        return Window(screen.screen, start_ns, end_ns, math.nan, share, valid_s, math.nan)
    value = float(np.median(diameters) if statistic is Statistic.MEDIAN else np.mean(diameters))
    slope = _slope(t_s[valid], diameters) / trace.native_per_mm
    return Window(screen.screen, start_ns, end_ns, value, share, valid_s, slope)


def _slope(t_s: Floats, diameters: Floats) -> float:
    """The median slope between blocks of 0.1 s (Theil and Sen's), which a blink at either end does not tilt."""
    block = np.floor(t_s / _SLOPE_BLOCK_S)
    edges = [0, *(np.flatnonzero(np.diff(block)) + 1).tolist(), t_s.size]
    blocks = [slice(start, end) for start, end in itertools.pairwise(edges)]
    if len(blocks) < 2:
        return 0.0
    middles = np.array([np.median(t_s[one]) for one in blocks])
    heights = np.array([np.median(diameters[one]) for one in blocks])
    earlier, later = np.triu_indices(len(blocks), 1)
    return float(np.median((heights[later] - heights[earlier]) / (middles[later] - middles[earlier])))


def _problems(result: EyeResult, protocol: Protocol) -> list[Problem]:
    """What is wrong with one eye; of what follows from something worse only that is named."""
    eye, unit = result.trace.eye, result.trace.unit
    for window in result.windows:
        if window.valid_share < MIN_VALID_SHARE or window.valid_s < min(MIN_VALID_S, _length_s(window)):
            detail = (
                f"{window.screen.value}: the pupil was tracked for {window.valid_s:.1f} of {_length_s(window):g} s "
                f"({window.valid_share:.0%}; {MIN_VALID_SHARE:.0%} are needed)"
            )
            return [Problem(Failure.TOO_FEW_SAMPLES, eye, detail)]
    white, black = result.of(Screen.WHITE), result.of(Screen.BLACK)
    figures = f"{white:.2f} {unit} before white, {black:.2f} {unit} before black"
    if result.span_mm <= -MIN_SPAN_MM:
        return [Problem(Failure.INVERTED, eye, figures)]
    if result.span_mm < MIN_SPAN_MM:
        needed = f"{MIN_SPAN_MM * result.trace.native_per_mm:.2f} {unit}"
        return [Problem(Failure.NO_SPAN, eye, f"{figures}: less than {needed} between them")]
    if not protocol.must_settle:
        return []
    problems = [
        Problem(
            Failure.DRIFTING,
            eye,
            f"{window.screen.value}: {window.slope_mm_s:+.2f} mm/s, and ±{MAX_SLOPE_MM_S:g} is the most",
        )
        for window in result.windows
        if abs(window.slope_mm_s) >= MAX_SLOPE_MM_S
    ]
    whites = [window.value / result.trace.native_per_mm for window in result.windows if window.screen is Screen.WHITE]
    if max(whites) - min(whites) > MAX_WHITES_MM:
        detail = f"the white screens differ by {max(whites) - min(whites):.2f} mm, and {MAX_WHITES_MM:g} is the most"
        problems.append(Problem(Failure.DRIFTING, eye, detail))
    return problems


def _disagreement(one: EyeResult, other: EyeResult) -> list[Problem]:
    # Provisional millimetres of two eye cameras say nothing of which pupil is the wider, but of how far each opens.
    apart = {"span": abs(one.span_mm - other.span_mm)}
    if one.trace.unit == other.trace.unit == "mm":
        apart |= {f"before {screen.value}": abs(one.of(screen) - other.of(screen)) for screen in _MEASURED}
    return [
        Problem(Failure.EYES_DISAGREE, None, f"{what}: {by_mm:.2f} mm apart, and {MAX_EYES_MM:g} is the most")
        for what, by_mm in apart.items()
        if by_mm > MAX_EYES_MM
    ]


_MEASURED = (Screen.WHITE, Screen.BLACK)


def _length_s(window: Window) -> float:
    return (window.to_ns - window.from_ns) / NS_PER_S
