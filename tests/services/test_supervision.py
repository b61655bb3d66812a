from entoptic.services.ipc.status import Gap
from entoptic.services.live.supervision import FIRST_S, LONGEST_S, MOST, WINDOW_S, WORKED_S, Restarts


def after(*crashes: tuple[float, float, float | None]) -> Restarts:
    """Each: when it was, how long the process had run, and how long it had been ready."""
    restarts = Restarts()
    for now_s, ran_s, worked_s in crashes:
        restarts = restarts.crashed(now_s, ran_s, worked_s)
    return restarts


def test_delays_double_up_to_the_longest() -> None:
    restarts, delays = Restarts(), []
    for k in range(7):
        restarts = restarts.crashed(100.0 + 10 * k, 9.0, 1.0)
        delays.append(restarts.delay_s)
        assert not restarts.given_up
    assert delays == [FIRST_S, 0.4, 0.8, 1.6, 3.2, LONGEST_S, LONGEST_S]


def test_long_work_forgives() -> None:
    restarts = after((0.0, 1.0, 0.5), (2.0, 1.0, 0.5), (40.0, WINDOW_S, 1.0))
    assert restarts.delay_s == FIRST_S
    assert restarts.crashes_s == (40.0,)


def test_five_crashes_within_the_window_are_enough() -> None:
    crashes = [(k * 7.0, 5.0, 0.5) for k in range(MOST)]
    assert not after(*crashes[:-1]).given_up
    assert after(*crashes).given_up
    assert not after(*[(k * 8.0, 7.0, 0.5) for k in range(20)]).given_up


def test_crashes_of_processes_that_worked_do_not_count() -> None:
    worked = [(k * 5.0, 4.0, WORKED_S) for k in range(20)]
    assert not after(*worked).given_up
    assert after(*worked).delay_s == LONGEST_S
    between = [(k * 3.0, 2.5, WORKED_S if k % 2 else 0.1) for k in range(2 * MOST - 1)]
    assert not after(*between[:-1]).given_up
    assert after(*between).given_up


def test_a_process_that_is_never_ready_is_given_up_however_slow_it_starts() -> None:
    crashes = [(k * 60.0, 50.0, None) for k in range(MOST)]
    assert not after(*crashes[:-1]).given_up
    assert after(*crashes).given_up
    assert not after(*crashes[:-1], (400.0, 50.0, 0.5)).given_up


def test_a_gap_is_told_in_seconds_from_the_start() -> None:
    assert Gap("worker", 2_000_000_000, None, "killed").since(500_000_000) == {
        "process": "worker", "from_s": 1.5, "to_s": None, "why": "killed",
    }  # fmt: skip
    assert Gap("worker", 2_000_000_000, 3_000_000_000, "killed").since(500_000_000)["to_s"] == 2.5
