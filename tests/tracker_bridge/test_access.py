"""Who may hear the bridge."""

import errno
from pathlib import Path

import pytest
import zmq
from zmq.utils import z85
from zmq.utils.monitor import recv_monitor_message

from entoptic.tracker_bridge import access
from entoptic.tracker_bridge.access import ClientKeys, OpenAddressError, ServerKeys


@pytest.mark.parametrize(
    "address",
    ["tcp://127.0.0.1:5555", "tcp://127.0.0.1:*", "tcp://127.9.9.9:1", "tcp://[::1]:5555", "tcp://localhost:5555",
     "ipc:///tmp/eyes", "inproc://eyes"],
)  # fmt: skip
def test_what_only_this_machine_can_reach_needs_no_keys(address: str) -> None:
    access.refuse_open([address])


@pytest.mark.parametrize(
    "address",
    ["tcp://*:5555", "tcp://0.0.0.0:*", "tcp://192.168.1.7:5555", "tcp://[::]:5555", "tcp://eth0:5555",
     "tcp://lab-machine:5555", "tcp://128.0.0.1:5555", "ws://127.0.0.1.example.org:5555", "tcp://[fe80::1%eth0]:5555"],
)  # fmt: skip
def test_what_others_can_reach_is_refused_with_the_remedy(address: str) -> None:
    with pytest.raises(OpenAddressError, match="entoptic keys") as refused:
        access.refuse_open(["tcp://127.0.0.1:*", address])
    assert address in str(refused.value)


def request(mechanism: bytes, *credentials: bytes) -> list[bytes]:
    return [b"1.0", b"id", b"", b"10.0.0.9", b"", mechanism, *credentials]


def test_only_a_key_in_the_folder_opens_and_a_broken_file_neither_opens_nor_shuts(tmp_path: Path) -> None:
    known, unknown = (zmq.curve_keypair()[0] for _ in range(2))
    keys = ServerKeys(b"", b"", tmp_path)
    ask = request(b"CURVE", z85.decode(known))
    assert access.zap_reply(ask, keys)[2] == b"400"
    (tmp_path / "a_broken.key").write_bytes(b"\xff\x00")
    (tmp_path / "known.key").write_text(f'curve\n    public-key = "{known.decode()}"\n')
    assert access.zap_reply(ask, keys)[:3] == [b"1.0", b"id", b"200"]
    for stranger in (
        request(b"CURVE", z85.decode(unknown)),
        request(b"NULL"),
        request(b"PLAIN", b"known", known),
        request(b"CURVE"),
    ):
        assert access.zap_reply(stranger, keys)[2] == b"400"
    (tmp_path / "known.key").unlink()
    assert access.zap_reply(ask, keys)[2] == b"400"


def test_a_folder_that_cannot_be_read_lets_nobody_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise OSError(errno.EMFILE, "Too many open files")

    public, _ = zmq.curve_keypair()
    (tmp_path / "known.key").write_text(f'curve\n    public-key = "{public.decode()}"\n')
    assert access.is_known(public, tmp_path)
    monkeypatch.setattr(Path, "glob", refuse)
    assert not access.is_known(public, tmp_path)


def test_while_nobody_answers_for_the_keys_nobody_gets_in(tmp_path: Path) -> None:
    public, secret = zmq.curve_keypair()
    came_in, kept_out = zmq.EVENT_HANDSHAKE_SUCCEEDED, zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    server, client = context.socket(zmq.XPUB), context.socket(zmq.SUB)
    ServerKeys(public, secret, tmp_path).use(server)
    server.bind("tcp://127.0.0.1:*")
    ClientKeys(*zmq.curve_keypair(), public).use(client)
    monitor = client.get_monitor_socket(came_in | kept_out)
    client.connect(server.getsockopt_string(zmq.LAST_ENDPOINT))
    try:
        assert monitor.poll(20_000)
        assert recv_monitor_message(monitor)["event"] == kept_out
    finally:
        context.destroy(linger=0)
