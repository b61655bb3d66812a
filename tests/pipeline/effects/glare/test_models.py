"""Which kernels an eye's glare is made of."""

import numpy as np

from entoptic.pipeline.effects.glare import models
from entoptic.pipeline.effects.glare.models import GlareModel
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose

EYE = Observer(particles=50, gratings=0)
PPD = 5.0


def test_a_pupil_between_two_steps_is_blended_where_all_else_rests() -> None:
    mixture = models.mixture(GlareModel.WAVE, EYE, Pose(4.1), 1.0, PPD)
    assert [round(weight, 9) for _, weight in mixture] == [0.6, 0.4]


def test_an_eye_in_motion_has_one_kernel_made_for_the_very_pupil() -> None:
    """Kernels at steps of the pupil would never serve again."""
    pose = Pose(4.1, vitreous_deg=(1.0, 0.0))
    ((component, weight),) = models.mixture(GlareModel.WAVE, EYE, pose, 1.0, PPD)
    assert weight == 1.0
    own = models.wave_component(EYE, pose, PPD)
    np.testing.assert_allclose(component.scatters, own.scatters, rtol=0, atol=1e-4)


def test_an_eye_that_holds_still_keeps_its_kernel() -> None:
    squinting = Pose(4.1, openness=0.5)
    first, second = (models.mixture(GlareModel.WAVE, EYE, squinting, 1.0, PPD) for _ in range(2))
    assert first[0][0] is second[0][0]
