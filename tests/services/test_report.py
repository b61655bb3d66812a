from services.report.plots import NOT_TRACKING
from tracker_bridge.wire import Phase


def test_every_phase_in_which_a_pupil_is_not_tracked_is_shaded() -> None:
    assert set(NOT_TRACKING) == {phase.value for phase in Phase} - {Phase.TRACKING.value}
