"""Compiles what rendering may need before a clock runs."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import msgspec
import numpy as np

from entoptic.pipeline.budget import Choice
from entoptic.pipeline.effects import EFFECTS, Effects
from entoptic.pipeline.effects.effect import SKIPPED, Effect
from entoptic.pipeline.eye_pose import EyePose
from entoptic.pipeline.frame import Display, Frame, View
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.plan import Planning
from entoptic.pipeline.render import as_displayed, perceive
from entoptic.pipeline.viewing import RenderState


def warm_up(
    view: View,
    images: int,
    observer: Observer,
    display: Display,
    effects: Effects,
    planning: Planning,
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Renders frames that call for everything, at every level that a budget may choose; until `stopped`.

    A lamp too bright for float32 compiles another way of glare, a pupil between two computed ones makes a kernel of
    two, and dark tiles alone and fades are compiled apart. So is the frame as a renderer displays it, and each set of
    neighbours that run in one pass.
    """
    in_full = Planning(everything=True, leave_out=planning.leave_out)
    reduced = [] if planning.budget_ms is None else _reduced(effects)
    if planning.everything:
        neighbours: list[frozenset[str]] = []
    else:
        neighbours = [planning.leave_out | left_out for left_out in _left_out_of_passes(effects)]
    lamp = np.zeros((images, 3, view.height_px, view.width_px), np.float32)
    for lamp_cd_m2, asked, plan in (
        (5e3, effects, in_full),
        (1e6, effects, in_full),
        *((5e3, one, in_full) for one in reduced),
        *((5e3, effects, Planning(everything=True, leave_out=leave_out)) for leave_out in neighbours),
    ):
        if stopped():
            return
        # A colour that no display has at that luminance: what maps it is compiled as well.
        lamp[:, :2, view.height_px // 2, view.width_px // 2] = lamp_cd_m2
        frame = Frame.from_rgb(lamp, view.fov_deg)
        perceive(
            frame, EyePose(pupil_diameter_mm=4.1), observer=observer, display=display, effects=asked, planning=plan
        )
    if stopped():
        return
    lamp[:] = 100.0
    lamp[:, :, : view.height_px // 8, : view.width_px // 8] = 1e-3
    bright = Frame.from_rgb(lamp, view.fov_deg)
    fading = {
        effect.name: Choice(effect.full_level(effect.settings_of(effects)), SKIPPED, 0.5)
        for effect in EFFECTS
        if effect.optional
    }
    before = RenderState((1.0,) * images, choices=fading)
    perceive(
        bright,
        EyePose(pupil_diameter_mm=4.0),
        observer=observer,
        display=display,
        state=before,
        effects=effects,
        planning=planning,
    )
    as_displayed(bright, display)


def _reduced(effects: Effects) -> list[Effects]:
    """All effects as they are asked for, but for one at a reduced level that runs."""
    return [
        msgspec.structs.replace(effects, **{effect.name: effect.at_level(settings, level)})
        for effect in EFFECTS
        for settings in (effect.settings_of(effects),)
        for level in effect.reduced_levels(settings)
        if level != SKIPPED
    ]


def _left_out_of_passes(effects: Effects) -> list[frozenset[str]]:
    """Each set of effects that passes may do without, but for none."""
    names = [
        effect.name
        for effect in EFFECTS
        if effect.optional
        and type(effect).pointwise is not Effect.pointwise
        and effect.is_on(effect.settings_of(effects))
    ]
    sets = (itertools.combinations(names, count) for count in range(1, len(names) + 1))
    return [frozenset(one) for one in itertools.chain.from_iterable(sets)]
