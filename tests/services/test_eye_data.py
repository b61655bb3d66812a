"""What goes with which eye data."""

import pytest

from entoptic.services.eye_data import open_eyes
from entoptic.tracker_bridge.source import SourceError


@pytest.mark.parametrize("spec", ["capture", "usb", "my_recording/", "usb-simulated:my_recording/"])
def test_light_is_for_simulated_eyes_alone(spec: str) -> None:
    with pytest.raises(SourceError, match="no luminance drives"):
        open_eyes(spec, None, None, 0, "100")


def test_simulated_eyes_take_it() -> None:
    assert open_eyes("simulated", None, 0.5, 0, "100").info.t_end_ns is not None
