"""Which functions an eye's glare is made of."""

import numpy as np
import pytest

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
    ((part, weight),) = models.mixture(GlareModel.WAVE, EYE, pose, 1.0, PPD)
    assert weight == 1.0
    own = models.wave_part(EYE, pose, PPD)
    np.testing.assert_allclose(part.cells(PPD, 30, 1.0), own.cells(PPD, 30, 1.0), rtol=0, atol=1e-3)


def test_an_eye_that_holds_still_keeps_its_kernel() -> None:
    squinting = Pose(4.1, openness=0.5)
    first, second = (models.mixture(GlareModel.WAVE, EYE, squinting, 1.0, PPD) for _ in range(2))
    assert first[0][0] is second[0][0]


@pytest.mark.parametrize("model", GlareModel)
@pytest.mark.parametrize("per_deg", [2.5, 30.0])
def test_a_part_has_the_light_of_a_point_whatever_its_cells(model: GlareModel, per_deg: float) -> None:
    reach = round(9 * per_deg)
    offset = np.arange(-reach, reach + 1) / per_deg
    inside = np.hypot(offset[:, None], offset) < 3.5
    for part, _ in models.mixture(model, Observer(gratings=60), Pose(4.0), 1.0, PPD):
        cells = part.cells(per_deg, reach, 1.0)
        within = cells[:, :, inside].sum(axis=2)
        other = part.cells(10.0, 90, 1.0)
        away = np.hypot(*np.meshgrid(np.arange(-90, 91) / 10, np.arange(-90, 91) / 10))
        np.testing.assert_allclose(within, other[:, :, away < 3.5].sum(axis=2), atol=0.03)
