from services.live.supervision import FIRST_S, LONGEST_S, MOST, WINDOW_S, Gap, Restarts


def after(*crashes: tuple[float, float, bool]) -> Restarts:
    restarts = Restarts()
    for now_s, ran_s, was_ready in crashes:
        restarts = restarts.crashed(now_s, ran_s, was_ready=was_ready)
    return restarts


def test_delays_double_up_to_the_longest() -> None:
    restarts, delays = Restarts(), []
    for k in range(7):
        restarts = restarts.crashed(100.0 + 10 * k, 9.0, was_ready=True)
        delays.append(restarts.delay_s)
        assert not restarts.given_up
    assert delays == [FIRST_S, 0.4, 0.8, 1.6, 3.2, LONGEST_S, LONGEST_S]


def test_long_work_forgives() -> None:
    restarts = after((0.0, 1.0, True), (2.0, 1.0, True), (40.0, WINDOW_S, True))
    assert restarts.delay_s == FIRST_S
    assert restarts.crashes_s == (40.0,)


def test_five_crashes_within_the_window_are_enough() -> None:
    crashes = [(k * 7.0, 5.0, True) for k in range(MOST)]
    assert not after(*crashes[:-1]).given_up
    assert after(*crashes).given_up
    assert not after(*[(k * 8.0, 7.0, True) for k in range(20)]).given_up


def test_a_process_that_is_never_ready_is_given_up_however_slow_it_starts() -> None:
    crashes = [(k * 60.0, 50.0, False) for k in range(MOST)]
    assert not after(*crashes[:-1]).given_up
    assert after(*crashes).given_up
    assert not after(*crashes[:-1], (400.0, 50.0, True)).given_up


def test_a_gap_is_told_in_seconds_from_the_start() -> None:
    assert Gap("worker", 2_000_000_000, None, "killed").since(500_000_000) == {
        "process": "worker", "from_s": 1.5, "to_s": None, "why": "killed",
    }  # fmt: skip
    assert Gap("worker", 2_000_000_000, 3_000_000_000, "killed").since(500_000_000)["to_s"] == 2.5
