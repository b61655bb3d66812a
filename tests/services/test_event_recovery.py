"""The events' protocol over any network: messages lost, late, repeated and reordered, answers too."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.services.event_recovery import ANSWER_WITHIN_S, ATTEMPTS, Answer, EventRecovery, Request
from entoptic.tracker_bridge.events import Event, Heartbeat, SourceBack
from entoptic.tracker_bridge.wire import NumberedEvent

HELPING = 4
"""Messages an answer."""


def event(number: int, stream: int = 1) -> NumberedEvent:
    return NumberedEvent(stream, number, 5557, SourceBack(number))


def heartbeat(number: int, stream: int = 1) -> NumberedEvent:
    return NumberedEvent(stream, number, 5557, Heartbeat(number, 0, 0))


def answer(request: Request, count: int, kept: int = 10**6) -> Answer:
    """What a bridge says that has published so many events and keeps the last few and the first."""
    oldest = max(count - kept + 1, 1)
    if request.first < oldest:
        return Answer((event(1, request.stream),), oldest)
    last = min(count, request.first + HELPING - 1)
    return Answer(tuple(event(number, request.stream) for number in range(request.first, last + 1)))


def numbers(events: list[Event]) -> list[int]:
    return [one.t_ns for one in events]


def test_answers_whose_events_came_meanwhile_are_no_failed_attempts() -> None:
    recovery = EventRecovery()
    got = numbers(recovery.message(event(1)))
    for first in range(2, 2 + 2 * (ATTEMPTS + 1), 2):
        got += numbers(recovery.message(heartbeat(first)))
        request = recovery.next_request(0.0)
        assert request is not None
        assert request.first == first
        got += numbers(recovery.message(event(first)))  # late
        got += numbers(recovery.message(heartbeat(first + 1)))
        got += numbers(recovery.answer(request, Answer((event(first),))))
        got += numbers(recovery.message(event(first + 1)))
    assert recovery.next_request(0.0) is None
    assert got == list(range(1, 2 + 2 * (ATTEMPTS + 1)))
    assert recovery.lost == 0


@pytest.mark.parametrize("of_no_use", [Answer(), Answer((None, None)), Answer((event(2, stream=9),)), None])
def test_a_gap_is_given_up_after_some_requests_that_brought_nothing(of_no_use: Answer | None) -> None:
    recovery = EventRecovery()
    recovery.message(event(1))
    recovery.message(event(4))
    now_s = 0.0
    for _ in range(ATTEMPTS):
        request = recovery.next_request(now_s)
        assert request is not None
        assert recovery.next_request(now_s) is None
        if of_no_use is None:
            now_s += ANSWER_WITHIN_S
        else:
            assert recovery.answer(request, of_no_use) == []
    assert recovery.lost == 0
    assert recovery.next_request(now_s) is None
    assert recovery.lost == 3
    assert numbers(recovery.message(event(5))) == [5]


def test_what_cannot_be_read_costs_no_other_wherever_it_stands() -> None:
    recovery = EventRecovery()
    recovery.message(event(1))
    recovery.message(heartbeat(4))
    request = recovery.next_request(0.0)
    assert request is not None
    assert numbers(recovery.message(event(2))) == [2]  # it can be read here, and not in the answer
    assert numbers(recovery.answer(request, Answer((None, event(3), None)))) == [3]
    assert (recovery.last, recovery.lost) == (4, 1)


@given(st.data())
def test_delivered_and_lost_make_up_all_events_once_and_in_order(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 20), "events")
    kept = data.draw(st.sampled_from([5, 100]), "kept by the bridge")
    patient = data.draw(st.booleans(), "every request is answered in time")
    recovery, got, published, now_s = EventRecovery(), [], 0, 0.0
    sent: list[NumberedEvent] = []
    asked: list[Request] = []
    steps = ["publish", "message", "heartbeat", "answer"] + ([] if patient else ["wait"])
    for step in data.draw(st.lists(st.sampled_from(steps), max_size=80), "steps"):
        if step == "publish" and published < count:
            published += 1
            sent.append(event(published))
        elif step == "message" and sent:
            got += recovery.message(data.draw(st.sampled_from(sent)))
        elif step == "heartbeat" and published:
            got += recovery.message(heartbeat(published))
        elif step == "answer" and asked:
            request = data.draw(st.sampled_from(asked))  # late ones and a second time too
            got += recovery.answer(request, answer(request, published, kept))
        elif step == "wait":
            now_s += ANSWER_WITHIN_S
        if request := recovery.next_request(now_s):
            asked.append(request)
        assert len(got) + recovery.lost == recovery.last <= recovery.known <= published
    # From here on the bridge answers, whatever went before.
    recovery_steps = 0
    if published:
        got += recovery.message(heartbeat(published))
    while recovery.last < published:
        if request := recovery.next_request(now_s):
            asked.append(request)
        got += recovery.answer(asked[-1], answer(asked[-1], published, kept))
        recovery_steps += 1
        assert recovery_steps <= count + 1
    assert len(got) + recovery.lost == published
    assert numbers(got) == sorted(set(numbers(got)))
    if patient and kept > count:
        assert recovery.lost == 0


def test_another_bridge_begins_again_and_late_answers_to_the_old_one_are_ignored() -> None:
    recovery = EventRecovery()
    recovery.message(event(1))
    recovery.message(event(3))
    old = recovery.next_request(0.0)
    assert old is not None
    assert numbers(recovery.message(event(1, stream=2))) == [1]
    assert recovery.lost == 2
    assert recovery.answer(old, answer(old, 3)) == []
    assert recovery.message(event(3, stream=2)) == []
    request = recovery.next_request(0.0)
    assert request is not None
    assert (request.stream, request.first) == (2, 2)


def test_an_answer_of_another_stream_gives_nothing_up() -> None:
    """A bridge that was started again answers on the same port what the one before was asked."""
    recovery = EventRecovery()
    got = numbers(recovery.message(event(1)))
    got += numbers(recovery.message(event(4)))
    request = recovery.next_request(0.0)
    assert request is not None
    assert recovery.answer(request, Answer((event(1, stream=9),), 1000)) == []
    assert (recovery.lost, recovery.last) == (0, 1)
    asked_again = recovery.next_request(10.0) or request
    got += numbers(recovery.answer(asked_again, Answer((event(2), event(3), event(4)))))
    got += numbers(recovery.message(event(5)))
    assert got == [1, 2, 3, 4, 5]
