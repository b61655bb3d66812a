"""Pupil Core's datums of a whole session, as a source: one sample an image, and a direction where there is none."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from entoptic.tracker_bridge.samples import Eye, GazeSample, direction_deg
from entoptic.tracker_bridge.sources.loaded import LoadedSource, load
from entoptic.tracker_bridge.sources.pupil_core.datum import (
    SCENE_FOV_DEG,
    GazeDatum,
    PupilDatum,
    eye_axis,
    gaze_samples,
    needs_scene_fov,
    pupil_sample,
)
from entoptic.tracker_bridge.trust import MIN_CONFIDENCE

Floats = NDArray[np.float64]

Gaze = tuple[GazeDatum, tuple[PupilDatum, ...]]
"""A gaze datum and the pupil datums it was made of."""


def assemble(name: str, pupils: Sequence[PupilDatum], gazes: Sequence[Gaze], notes: Sequence[str]) -> LoadedSource:
    """A source of a session's datums, in any order.

    The 2-D and the 3-D datum of one image become one sample, that of the 3-D datum. Without pupil datums those that
    the gaze datums were made of are taken; without gaze datums the directions of the eyes in their own cameras,
    centred. The notes say which. Raises SourceError where there is no sample at all.
    """
    notes = [*notes]
    if not pupils:
        # Each pupil goes into several gaze datums, which is no fault of the recording: taken once, in silence.
        measured = [p for _, base in gazes for p in base if p.diameter is not None or p.diameter_3d is not None]
        pupils = list({(pupil.timestamp, pupil.id): pupil for pupil in measured}.values())
        notes.append(
            f"No pupil data of its own; pupils that were taken from the gaze data: {len(pupils):,}."
            if pupils
            else "No pupil data: diameters and blinks are not known."
        )
    images = _one_an_image(pupils)
    if len(images) < len(pupils):
        notes.append(f"Two-dimensional measurements that repeat an image were left out: {len(pupils) - len(images):,}.")
    # The first direction in a datum is what the datum is about; those behind it repeat from datum to datum.
    each = [samples for datum, base in gazes if (samples := gaze_samples(datum, base))]
    if len(each) < len(gazes):
        notes.append(
            f"Of {len(gazes):,} gaze data those without a direction were left out: {len(gazes) - len(each):,}."
        )
    directions = [samples[0] for samples in each]
    computed = [own for samples in each for own in samples[1:]]
    assumed = sum(needs_scene_fov(datum) for datum, _ in gazes)
    if assumed:
        width, height = SCENE_FOV_DEG
        notes.append(
            f"Of {len(gazes):,} gaze data those that give only a place in the scene image: {assumed:,}; "
            f"a field of view of {width:g}° by {height:g}° is assumed for them."
        )
    if not directions:
        computed = _centred(images)
        if computed:
            notes.append(
                "No calibrated gaze: each eye's direction comes from its own camera and is centred, so that its "
                "median counts as straight ahead. Movements are right, places are not."
            )
    return load(name, [pupil_sample(image) for image in images], directions, notes, computed)


def _one_an_image(pupils: Sequence[PupilDatum]) -> list[PupilDatum]:
    """All datums but those 2-D ones whose image also has a 3-D one."""
    with_3d = {(pupil.timestamp, pupil.id) for pupil in pupils if pupil.diameter_3d is not None}
    return [p for p in pupils if p.diameter_3d is not None or (p.timestamp, p.id) not in with_3d]


def _centred(pupils: Sequence[PupilDatum]) -> list[GazeSample]:
    """Each eye's direction from its own camera, turned so that its median over trusted pupils is straight ahead.

    A camera sits below and beside its eye, at an angle nobody has measured: only the change of direction is known.
    The turn is the shortest one, so that a roll of the camera about its own axis stays in. An eye without any trusted
    pupil gets no direction.
    """
    directions: list[GazeSample] = []
    for eye in Eye:
        seen = [(p, axis) for p in pupils if p.id is eye and (axis := eye_axis(p)) is not None]
        trusted = [axis for p, axis in seen if p.confidence >= MIN_CONFIDENCE]
        if not trusted:
            continue
        turned = np.array([axis for _, axis in seen]) @ _turn_to_front(np.median(np.array(trusted), axis=0)).T
        for (pupil, _), (right, up, forward) in zip(seen, turned.tolist(), strict=True):
            sample = pupil_sample(pupil)
            directions.append(GazeSample(sample.t_ns, eye, *direction_deg(right, up, forward), sample.confidence))
    return directions


def _turn_to_front(middle: Floats) -> Floats:
    """The 3×3 rotation by the least angle that turns a vector (right, up, forward) to (0, 0, 1): Rodrigues' formula.

    An eye camera sees its pupil only from the front, so `middle` is never near (0, 0, −1), where it has no answer.
    """
    right, up, forward = (middle / max(float(np.linalg.norm(middle)), 1e-9)).tolist()
    cross = np.array([[0.0, 0.0, -right], [0.0, 0.0, -up], [right, up, 0.0]])
    turn: Floats = np.eye(3) + cross + cross @ cross / (1.0 + max(forward, -0.999))
    return turn
