"""Ways of the effects whose images are in cd/m² of the scene: adaptation, glare, acuity, rod noise."""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from entoptic.pipeline.cost.plain import adaptation as plain_adaptation
from entoptic.pipeline.cost.plain.glare import prepare
from entoptic.pipeline.cost.ways.stage import Reals, Stage
from entoptic.pipeline.cost.ways.way import SKIPPED, Way, Ways
from entoptic.pipeline.effects import acuity, adaptation, rod_noise
from entoptic.pipeline.effects.acuity import Acuity, AcuityMethod
from entoptic.pipeline.effects.acuity.reference import reference_acuity
from entoptic.pipeline.effects.adaptation import Adaptation, Target
from entoptic.pipeline.effects.glare import Glare, GlareLevel, GlareModel
from entoptic.pipeline.effects.glare.reference import of_mixture, reference_glare
from entoptic.pipeline.effects.rod_noise import RodNoise

NOISE_S = 1.0
"""When in a session noise is drawn."""


def adaptation_ways(stage: Stage) -> Ways:
    """Each target, from tiles against all pixels. Their image is the scene as an eye adapted to it is exposed."""
    rgb = np.asarray(stage.rgb, np.float64)
    view = stage.scene.frame.view
    true_cd_m2 = {
        Target.LUI: lambda: plain_adaptation.target_cd_m2(rgb, view),
        Target.KRI: lambda: plain_adaptation.log_mean_cd_m2(rgb),
        Target.BAR_SCENE: lambda: plain_adaptation.mean_cd_m2(rgb),
        Target.BAR_VIEW: lambda: plain_adaptation.middle_mean_cd_m2(rgb),
    }

    def exposed(adapted_cd_m2: float) -> Reals:
        # For the same display: brighter by as much as the exposure is larger than that of the scene's own target.
        return stage.resolved * (plain_adaptation.exposure(adapted_cd_m2) / stage.exposure)

    def true(target: Target) -> Reals:
        return exposed(true_cd_m2[target]())

    def way(name: str, settings: Adaptation) -> Way:
        target = functools.partial(adaptation.target_cd_m2, stage.scene.measured, 0.0, 0.0, settings)
        return Way(name, target, settings.target.value, exposed)

    return Ways(
        [
            *(way(target.value, Adaptation(target=target)) for target in Target),
            way("lui, robust", Adaptation(robust=True)),
        ],
        {target.value: functools.partial(true, target) for target in Target},
    )


def glare_ways(stage: Stage) -> Ways:
    """Each level against the reference of the same kernel; each other model at the level `frame`, against an FFT."""
    rgb = np.asarray(stage.rgb, np.float64)
    view = stage.scene.frame.view
    wave = GlareModel.WAVE.value
    levels = [
        Way(level.value, functools.partial(stage.glare, Glare(level=level)), wave, _image)
        for level in (GlareLevel.VEIL, GlareLevel.SOURCES, GlareLevel.WINDOW, GlareLevel.FRAME)
    ]
    models = [
        Way(
            f"{model.value}, frame",
            functools.partial(stage.glare, Glare(model=model, level=GlareLevel.FRAME)),
            model.value,
            _image,
        )
        for model in GlareModel
        if model is not GlareModel.WAVE
    ]

    def plainly(model: GlareModel) -> Reals:
        return prepare(view, stage.kernel(model))(rgb)

    truths: dict[str, Callable[[], Reals]] = {
        wave: lambda: reference_glare(rgb, view, *of_mixture(stage.kernel())),
        **{model.value: functools.partial(plainly, model) for model in GlareModel if model is not GlareModel.WAVE},
    }
    return Ways([Way(SKIPPED, None, wave, lambda _: rgb), *levels, *models], truths, timed_truth=(wave,))


def acuity_ways(stage: Stage) -> Ways:
    """Each method against the true filter of the same widths."""
    rgb = jnp.asarray(stage.glared)[None]
    exact = stage.glared.astype(np.float64)
    ppd = stage.scene.frame.view.ppd_centre
    settings = {method.value: Acuity(method=method) for method in AcuityMethod}
    settings |= {"krawczyk, no display limit": Acuity(method=AcuityMethod.KRAWCZYK, display_limit=False)}

    def true(of: Acuity) -> Reals:
        return np.asarray(reference_acuity(exact[None], ppd, of)[0])

    def in_tiles() -> Array:
        range_ = stage.measured_glared.range_cd_m2
        dark = acuity.dark_tiles(range_, ppd, Acuity())
        return acuity.reduce_acuity(rgb, ppd, Acuity(), dark, range_.tile_px)

    return Ways(
        [
            Way(SKIPPED, None, AcuityMethod.FIT.value, lambda _: exact),
            Way("fit, dark tiles", in_tiles, AcuityMethod.FIT.value, _eye),
            *(
                Way(name, functools.partial(acuity.reduce_acuity, rgb, ppd, of), name, _eye)
                for name, of in settings.items()
            ),
        ],
        {name: functools.partial(true, of) for name, of in settings.items()},
        timed_truth=tuple(settings),
    )


def rod_noise_ways(stage: Stage) -> Ways:
    """With and without: what is random has no truth but itself."""
    rgb = jnp.asarray(stage.resolved)[None]
    ppd, pupil_mm = stage.scene.frame.view.ppd_centre, [stage.pose.pupil_mm]

    def noisy() -> Array:
        return rod_noise.add_noise(rgb, NOISE_S, pupil_mm, ppd, RodNoise(on=True))

    exact = stage.resolved.astype(np.float64)
    return Ways(
        [Way(SKIPPED, None, "on", lambda _: exact), Way("on", noisy, "on", _eye)],
        {"on": lambda: _eye(noisy())},
    )


def _image(result: Array) -> Reals:
    return np.asarray(result, np.float64)


def _eye(result: Array) -> Reals:
    """Of the one eye."""
    return _image(result[0])
