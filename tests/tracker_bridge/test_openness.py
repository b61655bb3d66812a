"""Openness from the pupil, against the simulated lid, which was written apart from it."""

import numpy as np
import pytest

from entoptic.tracker_bridge.lids import estimated_openness
from entoptic.tracker_bridge.sources.simulated.lid import visible_area, visible_height


@pytest.mark.parametrize("pupil_diameter_mm", [2.0, 4.0, 7.0])
def test_it_undoes_what_a_lid_does_to_a_pupil(pupil_diameter_mm: float) -> None:
    touching = np.linspace(0.5 - pupil_diameter_mm / 20, 0.5 + pupil_diameter_mm / 20, 50)
    shares = np.sqrt(visible_area(visible_height(touching, np.full(50, pupil_diameter_mm))))
    estimates = [estimated_openness(share, pupil_diameter_mm) for share in shares.tolist()]
    assert estimates[:-1] == pytest.approx(touching[:-1].tolist(), abs=0.005)


def test_a_whole_pupil_is_an_open_eye() -> None:
    assert estimated_openness(1.0, 4.0) == estimated_openness(1.2, None) == 1.0


def test_without_a_diameter_it_is_that_of_a_usual_pupil() -> None:
    assert estimated_openness(0.5, None) == estimated_openness(0.5, 4.0)
