import errno

from entoptic.services.ipc.status import (
    BridgeStatus,
    HostStatus,
    Problem,
    WorkerStatus,
    merged,
    problem,
    status_of,
    unwritable,
)


def test_a_full_disk_is_one_problem_whoever_says_it() -> None:
    full = OSError(errno.ENOSPC, "No space left on device")
    both = merged([unwritable("/study/one", full)], [unwritable("/study/one", full)])
    assert [one.code for one in both] == ["disk full"]
    assert "/study/one ended: No space left on device." in both[0].what
    assert unwritable("/study/one", OSError(errno.EFBIG, "File too large")).code == "recording failed"


def test_the_worst_comes_first() -> None:
    note, error = Problem("a", "note", "A.", "B."), Problem("b", "error", "A.", "B.")
    assert merged([note], [error]) == (error, note)


def test_a_status_says_whose_it_is() -> None:
    assert status_of({"of": "bridge", "source": "eyes", "of another version": 1}) == BridgeStatus(source="eyes")
    assert status_of({"of": "worker", "revision": 3}) == WorkerStatus(revision=3)
    assert status_of({"of": "host", "worker": {"of": "worker", "fps": 2.0}}) == HostStatus(worker=WorkerStatus(fps=2.0))
    for nonsense in (None, {}, {"of": "moon"}, {"of": "bridge", "states": "many"}, {"of": "host", "addresses": {}}):
        assert status_of(nonsense) is None


def test_texts_become_sentences_and_file_names_stay() -> None:
    assert str(problem("x", "note", "the disk is full", "make room.")) == "The disk is full. Make room."
    assert problem("x", "note", "nowhere/ does not exist", "name another").what == "nowhere/ does not exist."
