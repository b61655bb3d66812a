"""A simulated eye tracker: what it reports of eyes that are known exactly, with the faults that real ones have."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.sources.simulated.lid import visible_area, visible_height
from entoptic.tracker_bridge.sources.simulated.truth import Truth

Floats = NDArray[np.float64]

LOST_MM = -0.07
"""The diameter that Pupil Core's 3-D detector reports where there is no pupil (seen in recordings of Capture 3.6)."""

LOST_MODEL_CONFIDENCE = 0.1
"""What the same detector then says of its model."""

PX_PER_MM = 4.93
"""Of the eye camera's image: a 4.03 mm pupil measured 19.87 px in a 192 px image of Capture 3.6."""

_LOST_BELOW = 0.4
"""A pupil is lost when less of its height is to see. Engineering choice; a little less than half, so that the tracker
goes on measuring a half-covered pupil, too small, at a confidence that passes for good: what Pupil Core does."""

_CONFIDENCE_OPEN, _CONFIDENCE_LAST = 0.99, 0.65
"""Confidence of a whole pupil, and of the least that is measured."""

_EYE_RADIUS_MM = 10.39
"""From the eye's centre of rotation to the pupil's plane in Pupil Core's eye model (pye3d)."""

_LOST_GAZE_NOISE_DEG = 5.0
"""Engineering choice: without a pupil the detector follows lashes and shadows."""

_OPENNESS_NOISE = 0.01


@dataclasses.dataclass(frozen=True)
class Measured:
    """What a tracker reports at n times; all arrays have the shape (2, n), the right eye first."""

    pupil_diameter_mm: Floats
    confidence: Floats
    model_confidence: Floats
    openness: Floats
    azimuth_deg: Floats
    elevation_deg: Floats


def measure(rng: np.random.Generator, truth: Truth, gaze_noise_deg: float, diameter_noise_mm: float) -> Measured:
    """What a tracker reports of these eyes.

    A lid that comes down first shrinks the measured diameter to that of a circle with the area still to see, pulls the
    apparent gaze down with the middle of what is to see, and lowers the confidence a little; then the pupil is lost.
    """
    shape = truth.azimuth_deg.shape
    height = np.broadcast_to(visible_height(truth.openness, truth.pupil_diameter_mm), shape)
    lost = height < _LOST_BELOW
    diameter = truth.pupil_diameter_mm * np.sqrt(visible_area(height)) + rng.normal(0.0, diameter_noise_mm, shape)
    covered = (1.0 - height) / (1.0 - _LOST_BELOW)
    confidence = _CONFIDENCE_OPEN - (_CONFIDENCE_OPEN - _CONFIDENCE_LAST) * covered
    pulled_down = np.degrees((1.0 - height) * truth.pupil_diameter_mm / 2 / _EYE_RADIUS_MM)
    noise = rng.normal(0.0, 1.0, (2, *shape)) * np.where(lost, _LOST_GAZE_NOISE_DEG, gaze_noise_deg)
    return Measured(
        pupil_diameter_mm=np.where(lost, LOST_MM, diameter),
        confidence=np.where(lost, 0.0, confidence - 0.01 * rng.random(shape)),
        model_confidence=np.where(lost, LOST_MODEL_CONFIDENCE, 1.0),
        openness=np.clip(truth.openness + rng.normal(0.0, _OPENNESS_NOISE, shape), 0.0, 1.0),
        azimuth_deg=truth.azimuth_deg + noise[0],
        elevation_deg=truth.elevation_deg - pulled_down + noise[1],
    )


def samples_of(measured: Measured, times_ns: Sequence[int]) -> Iterator[list[PupilSample | GazeSample]]:
    """The samples of each time: both pupils, then the direction of each eye and of both."""
    m = measured
    px = np.maximum(m.pupil_diameter_mm, 0.0) * PX_PER_MM
    pupils = np.stack([m.pupil_diameter_mm, m.confidence, m.model_confidence, px, m.openness], axis=-1)
    gazes = np.stack([m.azimuth_deg, m.elevation_deg, m.confidence], axis=-1)
    both = gazes.mean(axis=0)
    for at, t_ns in enumerate(times_ns):
        yield [
            *(PupilSample(t_ns, eye, *pupils[eye, at].tolist()) for eye in Eye),
            *(GazeSample(t_ns, eye, *gazes[eye, at].tolist()) for eye in Eye),
            GazeSample(t_ns, None, *both[at].tolist()),
        ]
