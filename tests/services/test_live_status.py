from entoptic.services.live.status import Found


def test_a_silent_tracker_is_wrong_whoever_says_it() -> None:
    assert Found("tcp://bridge", {"states": 9, "silent": None, "trouble": None}).wrong == ()
    said = {"silent": "no sample for 2 s"}
    assert Found("tcp://bridge", said).wrong == ("the tracker is silent: no sample for 2 s",)
    assert Found("tcp://host", {"figures": {"bridge": said, "worker": {}}}).wrong == Found("tcp://bridge", said).wrong
    assert Found("tcp://host", {"figures": {"bridge": {"silent": None}}, "processes": {}}).wrong == ()
