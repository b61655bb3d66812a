"""A simulated pair of eyes before a simulated tracker, with labels: the twin of a real source.

The same settings give the same samples to the bit. What the eyes do is drawn apart from how they are measured, so that
another noise, or another rate, shows the same movements and blinks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np

from entoptic.tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import SourceError, SourceInfo
from entoptic.tracker_bridge.sources.simulated.gaze import draw_movements, drift_deg, positions_deg
from entoptic.tracker_bridge.sources.simulated.lid import draw_blinks, openness_at
from entoptic.tracker_bridge.sources.simulated.pupil import STEP_S, light_reflex_mm, with_hippus_mm
from entoptic.tracker_bridge.sources.simulated.tracker import measure, samples_of
from entoptic.tracker_bridge.sources.simulated.truth import Truth, TruthEvent

_GRID_S = 0.001
"""The eyes are computed every millisecond, then looked at when the tracker does: a microsaccade lasts 6 ms or more."""

_DISJUNCTIVE = 0.2
"""Share of the drift that each eye has for itself. Engineering choice: 0.02° at the usual drift."""

Luminance = Annotated[float, msgspec.Meta(ge=0.0, le=1.6e9)]


class SimulatedSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What eyes and what tracker are simulated."""

    seconds: Annotated[float, msgspec.Meta(ge=0.1, le=3600.0)] = 60.0
    rate_hz: Annotated[float, msgspec.Meta(ge=30.0, le=1000.0)] = 200.0
    """Samples per second and eye."""
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)] = 1
    luminance: tuple[tuple[float, Luminance], ...] = ((0.0, 10.0), (15.0, 500.0), (30.0, 1.0), (45.0, 100.0))
    """The light: from when, in s, rising from 0; and the luminance then, cd/m²."""
    field_deg2: Annotated[float, msgspec.Meta(ge=0.01, le=41_253.0)] = 900.0
    """Area of the field that shines, at most the whole sphere."""
    age_years: Annotated[float, msgspec.Meta(ge=20.0, le=83.0)] = 30.0
    """The range of Watson & Yellott's data."""
    hippus: Annotated[float, msgspec.Meta(ge=0.0, le=0.3)] = 0.1
    """Strength of the pupil's unrest; 0.1 is ± 0.17 mm at 4 mm."""
    blinks_per_minute: Annotated[float, msgspec.Meta(ge=0.0, le=40.0)] = 15.0
    saccades_per_minute: Annotated[float, msgspec.Meta(ge=0.0, le=180.0)] = 20.0
    microsaccades_per_second: Annotated[float, msgspec.Meta(ge=0.0, le=3.0)] = 1.2
    drift_deg: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.1
    """How far the eyes wander about the place they look at, standard deviation per axis."""
    noise_deg: Annotated[float, msgspec.Meta(ge=0.0, le=5.0)] = 0.02
    """The tracker's noise in gaze, standard deviation per axis and eye."""
    diameter_noise_mm: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.01
    """The tracker's noise in the diameter, standard deviation."""


class SimulatedEyes:
    """A source of simulated samples; `truth` says what the eyes really did.

    Raises SourceError that names the setting that is out of range.
    """

    def __init__(self, settings: SimulatedSettings) -> None:
        _refuse_out_of_range(settings)
        self.settings = settings
        own_rngs = [np.random.default_rng(child) for child in np.random.SeedSequence(settings.seed).spawn(5)]
        self.truth = _live(settings, *own_rngs[:4])
        self._measured = measure(own_rngs[4], self.truth, settings.noise_deg, settings.diameter_noise_mm)
        self._info = SourceInfo(
            name=f"Simulated eyes {settings.seed}",
            t_start_ns=int(self.truth.t_ns[0]),
            t_end_ns=int(self.truth.t_ns[-1]),
            notes=("Nobody's eyes: every sample is computed.",),
        )

    @property
    def info(self) -> SourceInfo:
        """What this source is."""
        return self._info

    def samples(self) -> Iterator[PupilSample | GazeSample]:
        """All samples in the order of their time: at each both pupils, then the direction of each eye and of both."""
        for group in samples_of(self._measured, self.truth.t_ns.tolist()):
            yield from group

    def write_truth_csv(self, path: Path) -> None:
        """Writes the labelled events as a table, one line each; see `Truth.write_csv`."""
        self.truth.write_csv(path)


def _refuse_out_of_range(settings: SimulatedSettings) -> None:
    try:
        msgspec.convert(msgspec.to_builtins(settings), SimulatedSettings)
    except msgspec.ValidationError as error:
        raise SourceError(f"simulated eyes: {error}") from None
    times = [t_s for t_s, _ in settings.luminance]
    if not times or times[0] != 0.0 or not all(math.isfinite(t_s) for t_s in times) or times != sorted(set(times)):
        raise SourceError("simulated eyes: the times in `luminance` must begin with 0 and rise")


def _live(
    settings: SimulatedSettings,
    lid_rng: np.random.Generator,
    movement_rng: np.random.Generator,
    drift_rng: np.random.Generator,
    pupil_rng: np.random.Generator,
) -> Truth:
    """What the eyes do."""
    blinks = draw_blinks(lid_rng, settings.seconds, settings.blinks_per_minute)
    movements = draw_movements(
        movement_rng, settings.seconds, blinks, settings.saccades_per_minute, settings.microsaccades_per_second
    )
    grid_s = _GRID_S * np.arange(math.ceil(settings.seconds / _GRID_S) + 1, dtype=np.float64)
    common = positions_deg(grid_s, movements) + drift_deg(drift_rng, grid_s.size, _GRID_S, settings.drift_deg)
    # eye, axis, time
    gaze = np.stack(
        [common + drift_deg(drift_rng, grid_s.size, _GRID_S, settings.drift_deg * _DISJUNCTIVE) for _ in Eye]
    )
    reflex = light_reflex_mm(settings.seconds, settings.luminance, settings.field_deg2, settings.age_years)
    diameter = with_hippus_mm(pupil_rng, reflex, settings.hippus)

    count = math.floor(settings.seconds * settings.rate_hz)
    t_ns = np.round(np.arange(count) * (NS_PER_S / settings.rate_hz)).astype(np.int64)
    t_s = t_ns / NS_PER_S
    events = [
        TruthEvent("blink", None, round(blink.onset_s * NS_PER_S), round(blink.end_s * NS_PER_S)) for blink in blinks
    ] + [
        TruthEvent(
            kind=movement.kind,
            eye=None,
            onset_ns=round(movement.onset_s * NS_PER_S),
            offset_ns=round(movement.end_s * NS_PER_S),
            amplitude_deg=movement.amplitude_deg,
            peak_velocity_deg_s=movement.peak_velocity_deg_s,
        )
        for movement in movements
    ]
    return Truth(
        events=tuple(sorted(events, key=lambda event: event.onset_ns)),
        t_ns=t_ns,
        azimuth_deg=np.stack([np.interp(t_s, grid_s, gaze[eye, 0]) for eye in Eye]),
        elevation_deg=np.stack([np.interp(t_s, grid_s, gaze[eye, 1]) for eye in Eye]),
        pupil_diameter_mm=np.interp(t_s, np.arange(diameter.size) * STEP_S, diameter),
        openness=openness_at(t_s, blinks),
    )
