"""Which functions an eye's glare is made of."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from entoptic.pipeline.effects.glare import Mixture, kernel, models, stamps
from entoptic.pipeline.effects.glare.models import GlareModel
from entoptic.pipeline.effects.glare.passing import Passing
from entoptic.pipeline.effects.glare.plane import plane_of
from entoptic.pipeline.frame import View
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics import moving_kernel
from entoptic.pipeline.optics.aperture import Pose

EYE = Observer(particles=50, gratings=0)
PPD = 5.0


def test_a_pupil_between_two_steps_is_blended_where_all_else_rests() -> None:
    mixture = models.mixture(GlareModel.WAVE, EYE, Pose(4.1), 1.0, PPD)
    assert [round(weight, 9) for _, weight in mixture] == [0.6, 0.4]


def cells(mixture: Mixture, per_deg: float, reach: int) -> np.ndarray:
    return np.asarray(sum(weight * part.cells(per_deg, reach, 1.0) for part, weight in mixture))


def test_an_eye_in_motion_is_eyes_at_rest_and_what_it_adds_to_them() -> None:
    pose = Pose(4.1, vitreous_deg=(1.0, 0.0))
    mixture = models.mixture(GlareModel.WAVE, EYE, pose, 1.0, PPD)
    assert [round(weight, 9) for _, weight in mixture] == [0.6, 0.4, 1.0]
    own = models.wave_part(EYE, pose, PPD)
    np.testing.assert_allclose(cells(mixture, PPD, 30), own.cells(PPD, 30, 1.0), rtol=0, atol=1e-3)


@pytest.mark.parametrize("lens", [False, True], ids=["without lens", "with lens"])
def test_each_frame_of_an_eye_in_motion_makes_one_kernel_that_never_serves_again(
    lens: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of the pupils around its own serve again."""
    made = []
    for name in ("change_kernel", "resting_kernel"):
        make = getattr(moving_kernel, name)
        monkeypatch.setattr(
            moving_kernel, name, lambda *args, name=name, make=make: (made.append(name), make(*args))[1]
        )
    models._near.cache_clear()
    for number in range(6):
        lens_m = np.full((17, 17), 1e-6 * number) if lens else None
        pose = Pose(4.1 + 0.01 * number, openness=0.5 + 0.01 * number, vitreous_deg=(0.1 * number, 0.1), lens_m=lens_m)
        models.mixture(GlareModel.WAVE, EYE, pose, 1.0, PPD)
    assert made.count("change_kernel") == 6
    assert made.count("resting_kernel") == 2


def test_what_an_eyes_motion_adds_is_prepared_as_any_other_part() -> None:
    plane = plane_of(View(200, 160, 60.0), 4)
    cells = models.wave_mixture(EYE, Pose(4.1, openness=0.5), plane.view.ppd_centre)[-1][0].cells
    quickly, plainly = (kernel.prepared(((part(cells, None), 1.0),), plane)[0][0] for part in (Passing, kernel.Part))
    for one, other in zip(jax.tree.leaves(quickly), jax.tree.leaves(plainly), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=2e-5 * float(np.abs(other).max()) + 1e-12)


def test_a_window_that_is_looked_up_once_a_pixel_has_the_light_of_one_looked_up_nine_times() -> None:
    view, reach = View(200, 200, 40.0), 6
    away = np.hypot(*np.indices((45, 45)) - 22) / kernel.FINE_PER_PX
    fine = jnp.asarray(np.exp(-away / 2), jnp.float32)[None, None]
    core = jnp.zeros((1, 1, 73, 73), jnp.float32)
    pixel_deg, middle = 1 / view.ppd_centre, np.array([[100, 100], [150, 40]])
    asked = pixel_deg, middle, middle + 0.5, view, reach
    once = stamps._passing_windows(stamps._averaged(fine), *asked)
    nine = stamps.windows(kernel.Sampled(fine, core), *asked)
    beyond = np.hypot(*np.indices((13, 13)) - reach) > 3.5
    np.testing.assert_allclose(once.density[..., beyond], nine.density[..., beyond], rtol=0.07, atol=2e-3)
    assert float(once.density[0, 0, 0, reach, reach]) == 0


def test_an_eye_that_holds_still_keeps_its_kernel() -> None:
    squinting = Pose(4.1, openness=0.5)
    first, second = (models.mixture(GlareModel.WAVE, EYE, squinting, 1.0, PPD) for _ in range(2))
    assert all(one is other for (one, _), (other, _) in zip(first, second, strict=True))


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
