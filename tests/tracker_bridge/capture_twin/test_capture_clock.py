import pytest

from entoptic.tracker_bridge.capture_twin.clock import CaptureClock


def test_an_offset_a_set_time_a_jump_and_a_restart() -> None:
    clock = CaptureClock(100.0, 5000.0)
    assert clock.pupil_s(101.0) == 5101.0
    clock.set(102.0, 7.0)
    assert clock.pupil_s(103.5) == 8.5
    clock.jump(100.0)
    assert clock.pupil_s(104.0) == 109.0
    clock.restart()
    assert clock.pupil_s(105.0) == 5105.0


def test_a_drift_begins_without_a_jump() -> None:
    clock = CaptureClock(0.0, 10.0)
    clock.drift(100.0, 200.0)
    assert clock.pupil_s(100.0) == 110.0
    assert clock.pupil_s(1100.0) == pytest.approx(1110.2)
    clock.set(1100.0, 0.0)
    assert clock.pupil_s(2100.0) == pytest.approx(1000.2)
