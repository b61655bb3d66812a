"""What goes with which eye data."""

import pytest

from entoptic.services.config import EyesConfig
from entoptic.services.eye_data import open_eyes
from entoptic.tracker_bridge.source import SourceError


@pytest.mark.parametrize("spec", ["capture", "usb", "my_recording/", "usb-simulated:my_recording/"])
def test_light_is_for_simulated_eyes_alone(spec: str) -> None:
    with pytest.raises(SourceError, match="no luminance drives"):
        open_eyes(EyesConfig(source=spec), luminance="100")


def test_simulated_eyes_answer_to_their_light_and_last_as_long_as_asked() -> None:
    dim, bright = (open_eyes(EyesConfig(), 0.5, luminance) for luminance in ("0.01", "10000"))
    assert dim.info.t_end_ns is not None
    assert 0.4e9 < dim.info.t_end_ns - dim.info.t_start_ns <= 0.5e9
    widest = [
        max(s.pupil_diameter_mm for s in eyes.samples() if getattr(s, "pupil_diameter_mm", None))
        for eyes in (dim, bright)
    ]
    assert widest[0] > widest[1] + 1.0
