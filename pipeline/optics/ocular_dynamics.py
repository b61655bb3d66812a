"""What moves in a living eye, from one frame to the next (RIT 3).

microfluctuations.py  accommodation wavers, and focus with it
lens_springs.py       the lens, deformed by that
vitreous_motion.py    the vitreous, left behind by saccades
value_noise.py        hippus, where nobody measures the pupil
damped.py             what all free motion is made of

Theory of operation: everything is a function of time and of the observer's seed, or a linear system whose motion has a
closed form. So a step is exact whatever its length: frames may be any time apart, and two steps are the same as one of
both lengths, as long as the pupil stays as it is. Lids follow what the tracker says and have no memory.

Latency: none but the lens' own, 40 ms behind accommodation, which is part of the model.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import lens_springs, microfluctuations, vitreous_motion
from entoptic.pipeline.optics.aperture import Pose, legal_pupil_diameter_mm
from entoptic.pipeline.optics.lens_springs import LensState
from entoptic.pipeline.optics.lids import clear_of
from entoptic.pipeline.optics.value_noise import value_noise
from entoptic.pipeline.optics.vitreous_motion import SaccadeImpulse, VitreousState

__all__ = ["OcularState", "SaccadeImpulse", "at_rest", "hippus_mm", "pose_of", "step"]

HIPPUS_MAX_MM = 9.0
"""The pupil at which hippus ends (RIT 1: p_max)."""
HIPPUS_NOISE = 0.2
"""How far the noise of RIT 1 goes, which does not say it. Engineering choice: a pupil of 3 mm then wavers by 0.16 mm
(standard deviation) and never by more than 0.49 mm, one of 6 mm by 0.06 mm; noise of ±1 would make it 0.5 to 5.4 mm."""
_HIPPUS_STREAM = 0x6869
REST_DEG = 1e-3
"""A vitreous turned by less counts as at rest, so that its kernel may serve again. Engineering choice: its particles
are then 0.15 µm from their places, a thirtieth of a sample of the pupil plane."""


@dataclasses.dataclass(frozen=True, eq=False)
class OcularState:
    """What of one eye is in motion."""

    t_s: float = 0.0
    """Time since the eye was at rest."""
    hippus_beats: float = 0.0
    """How far the noise of hippus has come: ∫ dt/p, s/mm, which is RIT's t/p for a pupil p that changes too."""
    lens: LensState | None = None
    """None while the lens has not moved."""
    vitreous: VitreousState = dataclasses.field(default_factory=VitreousState)


def at_rest(observer: Observer) -> OcularState:
    """An eye in which nothing has moved yet. The same for every observer: what makes theirs theirs is in `step`."""
    return OcularState()


def step(
    state: OcularState,
    observer: Observer,
    dt_s: float,
    pupil_diameter_mm: float,
    impulses: Sequence[SaccadeImpulse] = (),
) -> OcularState:
    """The eye `dt_s` later, with these turns of the eye in between; the same to the bit for the same arguments.

    Exact for any `dt_s`. Where time stands still, goes backwards or is no finite number (`dt_s` ≤ 0, infinite or NaN)
    no time passes: the state stays as it is, but for the impulses. `pupil_diameter_mm` is the pupil's mean diameter,
    clamped to what a pupil can be; NaN counts as the narrowest. A part that `observer.ocular_dynamics` leaves off
    stays as it is. The lens is moved by microfluctuations alone: without them it rests even where `lens` is on.
    """
    living = observer.ocular_dynamics
    passed_s = dt_s if 0.0 < dt_s < math.inf else 0.0
    pupil_diameter_mm = legal_pupil_diameter_mm(pupil_diameter_mm)
    lens, vitreous = state.lens, state.vitreous
    if passed_s and _lens_moves(observer):
        tones = microfluctuations.tones_d(observer.seed, pupil_diameter_mm)
        lens = lens_springs.step(lens or lens_springs.at_rest(), state.t_s, passed_s, tones)
    if living.vitreous and (passed_s or impulses):
        vitreous = vitreous_motion.step(vitreous, passed_s, impulses)
    return OcularState(state.t_s + passed_s, state.hippus_beats + passed_s / pupil_diameter_mm, lens, vitreous)


def pose_of(state: OcularState, observer: Observer, pupil_diameter_mm: float, openness: float, measured: bool) -> Pose:
    """How the eye stands: with everything in `observer.ocular_dynamics` off, at rest with this pupil.

    `pupil_diameter_mm` is the same as for `step`. Where it is `measured` it contains its hippus already, and none is
    added. `openness`, 0…1, is what the tracker says, and matters where `lids` is on; `squint` holds the lids no more
    open than `observer.squint_openness`, with `lids` or without. What is out of range is clamped.
    """
    living = observer.ocular_dynamics
    mean_mm = legal_pupil_diameter_mm(pupil_diameter_mm)
    fluctuation_d = 0.0
    if living.microfluctuations:
        fluctuation_d = microfluctuations.fluctuation_d(observer.seed, state.t_s, mean_mm)
    lens_m = None
    if state.lens is not None and _lens_moves(observer):
        lens_m = lens_springs.radial_m(state.lens, fluctuation_d)
    lids = min(max(openness, 0.0), 1.0) if living.lids else 1.0
    lids = min(lids, observer.squint_openness) if living.squint else lids
    wavers = living.hippus and not measured
    used_mm = hippus_mm(mean_mm, state.hippus_beats, observer.seed) if wavers else mean_mm
    lashes = living.lashes and lids < 1.0
    if not lashes and clear_of(lids, used_mm * 1e-3):
        # Lids that touch no light are as good as open: the kernel at rest serves.
        lids = 1.0
    turned = living.vitreous and max(abs(deg) for deg in state.vitreous.deg) >= REST_DEG
    return Pose(
        pupil_diameter_mm=used_mm,
        defocus_d=observer.defocus_d + fluctuation_d,
        openness=lids,
        lashes=lashes,
        vitreous_deg=state.vitreous.deg if turned else (0.0, 0.0),
        lens_m=lens_m,
    )


def hippus_mm(mean_mm: float, beats: float, seed: int) -> float:
    """A pupil of this mean diameter as it wavers, clamped to what a pupil can be (RIT 1, KRI 4.7)."""
    share = mean_mm / HIPPUS_MAX_MM
    noise = HIPPUS_NOISE * value_noise(beats, seed ^ _HIPPUS_STREAM)
    return legal_pupil_diameter_mm(mean_mm + noise / share * math.sqrt(1.0 - share))


def _lens_moves(observer: Observer) -> bool:
    return observer.ocular_dynamics.lens and observer.ocular_dynamics.microfluctuations
