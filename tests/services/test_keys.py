"""Key files, and that they keep others out on real sockets."""

import shutil
import stat
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import typer
import zmq
from typer.testing import CliRunner
from zmq.utils.monitor import recv_monitor_message

from entoptic.services import keys
from entoptic.services.commands.keys import keys as command
from entoptic.services.keys import KeysError
from entoptic.services.reader import ShutOutError, StateReader
from entoptic.tracker_bridge.access import ClientKeys
from entoptic.tracker_bridge.events import Heartbeat, StreamStarted
from entoptic.tracker_bridge.publisher import Publisher
from entoptic.tracker_bridge.samples import EyeState, OneEyeState, Phase

ANY = "tcp://127.0.0.1:*"
PATIENCE_MS = 60_000
SHUT_OUT = zmq.EVENT_HANDSHAKE_FAILED_AUTH | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
ONE = OneEyeState(Phase.TRACKING, 4.0, 4.0, 1.0, None, None)


def never() -> bool:
    return False


@pytest.fixture
def out(tmp_path: Path) -> Path:
    folder = tmp_path / "keys"
    keys.make_bridge(folder)
    return folder


def test_files_are_for_their_owner_alone_and_loaded_as_they_were_made(out: Path) -> None:
    folder = keys.make_client(out, "projector")
    assert {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()} == {
        "bridge/bridge.key", "bridge/bridge.key_secret", "bridge/clients/projector.key",
        "projector/client.key", "projector/client.key_secret", "projector/bridge.key",
    }  # fmt: skip
    for path in out.rglob("*"):
        assert stat.S_IMODE(path.stat().st_mode) == (0o700 if path.is_dir() else 0o600), path
    server, client = keys.load_server(out / "bridge"), keys.load_client(folder)
    assert client.bridge == server.public == zmq.curve_public(server.secret)
    assert client.public == zmq.curve_public(client.secret) != server.public
    assert server.clients == out / "bridge" / "clients"
    assert "secret" not in (out / "bridge" / "clients" / "projector.key").read_text().lower()


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_nothing_is_overwritten(out: Path) -> None:
    keys.make_client(out, "projector")
    before = contents(out)
    with pytest.raises(KeysError, match="not overwritten"):
        keys.make_bridge(out)
    with pytest.raises(KeysError, match="not overwritten"):
        keys.make_client(out, "projector")
    shutil.rmtree(out / "projector")  # taken to its machine
    with pytest.raises(KeysError, match=r"projector\.key.*not overwritten"):
        keys.make_client(out, "projector")
    assert contents(out) == {path: held for path, held in before.items() if path.parent != out / "projector"}


@pytest.mark.parametrize("name", ["", "bridge", "../etc", "a/b", "-x", "a b", "ä", "x" * 65, "a.key"])
def test_a_name_that_is_no_name_is_refused(out: Path, name: str) -> None:
    with pytest.raises(KeysError, match="no name for a reader"):
        keys.make_client(out, name)


def test_a_reader_of_no_bridge_is_refused(tmp_path: Path) -> None:
    with pytest.raises(KeysError, match=r"bridge\.key_secret"):
        keys.make_client(tmp_path, "projector")
    assert not (tmp_path / "projector").exists()


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("bridge/bridge.key_secret", None),
        ("bridge/bridge.key_secret", b""),
        ("bridge/bridge.key_secret", b'public-key = "short"\nsecret-key = "short"'),
        ("bridge/bridge.key_secret", b'public-key = "' + b"~" * 40 + b'"'),
        ("bridge/bridge.key_secret", b'public-key = "' + b"#" * 40 + b'"'),
        ("bridge/clients/projector.key", b"\xff\xfe"),
        ("projector/client.key_secret", None),
        ("projector/bridge.key", None),
        ("projector/bridge.key", b"public-key ="),
    ],
)
def test_a_file_that_holds_no_key_is_named(out: Path, file: str, content: bytes | None) -> None:
    keys.make_client(out, "projector")
    path = out / file
    path.unlink() if content is None else path.write_bytes(content)
    with pytest.raises(KeysError, match=path.name):
        (keys.load_server if file.startswith("bridge") else keys.load_client)(path.parents[len(Path(file).parts) - 2])


def test_a_secret_key_of_another_pair_is_named(out: Path) -> None:
    path = out / "bridge" / "bridge.key_secret"
    _, secret = zmq.curve_keypair()
    other, _ = zmq.curve_keypair()
    path.write_text(f'public-key = "{other.decode()}"\nsecret-key = "{secret.decode()}"\n')
    with pytest.raises(KeysError, match="not that of its public one"):
        keys.load_server(out / "bridge")


def test_the_command_makes_both_and_says_what_to_do_with_them(tmp_path: Path) -> None:
    app = typer.Typer()
    app.command()(command)
    out = tmp_path / "lab keys"
    done = CliRunner().invoke(app, ["--out", str(out), "--client", "projector"])
    assert done.exit_code == 0
    assert f"--keys {out / 'bridge'}" in done.stderr
    assert str(out / "projector") in done.stderr
    assert CliRunner().invoke(app, ["--out", str(out), "--client", "recorder", "--client", "watcher"]).exit_code == 0
    for reader in ("recorder", "watcher"):
        assert keys.load_client(out / reader).bridge == keys.load_server(out / "bridge").public
    assert isinstance(CliRunner().invoke(app, ["--out", str(out)]).exception, KeysError)


@pytest.fixture
def guarded(out: Path) -> Iterator[Publisher]:
    publisher = Publisher(ANY, ANY, keys=keys.load_server(out / "bridge"))
    publisher.publish_event(StreamStarted(0, None, "made up"))
    yield publisher
    publisher.close()


def say(publisher: Publisher) -> Callable[[], bool]:
    """Publishes one of each whenever a reader asks whether to stop: it never is."""

    def publish() -> bool:
        publisher.publish_state(EyeState(0, 0, ONE, ONE, None))
        publisher.publish_event(Heartbeat(0, 1, 0))
        return False

    return publish


def read_one_state(reader: StateReader, meanwhile: Callable[[], bool]) -> EyeState | None:
    deadline = time.monotonic() + PATIENCE_MS / 1e3
    while time.monotonic() < deadline:
        meanwhile()
        if (state := reader.newest()) is not None:
            return state
        time.sleep(0.01)
    return None


def test_a_reader_with_a_known_key_gets_states_events_and_replays(guarded: Publisher, out: Path) -> None:
    reader = StateReader(*guarded.addresses, keys=keys.load_client(keys.make_client(out, "late")))
    # Its key was added while the bridge ran; the stream's start had gone, so it comes by replay.
    assert reader.wait_for_start(say(guarded)) == StreamStarted(0, None, "made up")
    assert read_one_state(reader, say(guarded)) is not None
    reader.close()


def stranger() -> tuple[bytes, bytes]:
    return zmq.curve_keypair()


@pytest.mark.parametrize("who", ["without keys", "unknown key", "wrong bridge key"])
def test_anybody_else_gets_nothing(guarded: Publisher, out: Path, who: str) -> None:
    known = keys.load_client(keys.make_client(out, "known"))
    wrong = {
        "without keys": None,
        "unknown key": ClientKeys(*stranger(), known.bridge),
        "wrong bridge key": ClientKeys(known.public, known.secret, stranger()[0]),
    }[who]
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    sockets = [context.socket(kind) for kind in (zmq.SUB, zmq.SUB, zmq.DEALER)]
    monitors = []
    for socket, address in zip(sockets, (*guarded.addresses, guarded.replay_address), strict=True):
        if wrong is not None:
            wrong.use(socket)
        monitors.append(socket.get_monitor_socket(zmq.EVENT_DISCONNECTED | SHUT_OUT))
        if socket.type == zmq.SUB:
            socket.setsockopt(zmq.SUBSCRIBE, b"")
        socket.connect(address)
    sockets[2].send_multipart([b"", b"\x81\xa4from\x00"])
    for monitor in monitors:  # each was turned away at least once
        assert monitor.poll(PATIENCE_MS)
        recv_monitor_message(monitor)
    reader = StateReader(*guarded.addresses, keys=known)
    assert reader.wait_for_start(say(guarded)) is not None
    assert read_one_state(reader, say(guarded)) is not None
    assert [socket.poll(50) for socket in sockets] == [0, 0, 0]
    reader.close()
    context.destroy(linger=0)


def test_a_reader_that_is_shut_out_says_so_at_once(guarded: Publisher, out: Path) -> None:
    known = keys.load_client(keys.make_client(out, "known"))
    for wrong in (
        None,
        ClientKeys(*stranger(), known.bridge),
        ClientKeys(known.public, known.secret, stranger()[0]),
    ):
        reader = StateReader(*guarded.addresses, keys=wrong)
        with pytest.raises(ShutOutError, match="entoptic keys"):
            reader.wait_for_start(never)
        reader.close()


def test_a_reader_with_keys_does_not_hear_a_bridge_without(out: Path) -> None:
    known = keys.load_client(keys.make_client(out, "known"))
    publisher = Publisher(ANY, ANY)
    reader = StateReader(*publisher.addresses, keys=known)
    with pytest.raises(ShutOutError, match="has none itself"):
        reader.wait_for_start(say(publisher))
    reader.close()
    publisher.close()


def test_with_keys_a_bridge_may_listen_to_all_the_network(out: Path) -> None:
    publisher = Publisher("tcp://*:*", "tcp://0.0.0.0:*", keys=keys.load_server(out / "bridge"))
    publisher.publish_event(StreamStarted(0, None, "made up"))
    client = keys.load_client(keys.make_client(out, "near"))
    here = [address.replace("0.0.0.0", "127.0.0.1") for address in publisher.addresses]
    reader = StateReader(*here, keys=client)
    assert reader.wait_for_start(say(publisher)) is not None  # the replay's port goes with the host it reads from
    reader.close()
    publisher.close()


def test_keys_in_a_file_s_place_are_refused_for_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "a_file").write_text("")
    with pytest.raises(keys.KeysError, match=r"a_file.bridge: .*; choose another --out"):
        keys.make_bridge(tmp_path / "a_file")


def test_keys_that_are_there_are_said_and_no_fault_to_ask_for_again(tmp_path: Path) -> None:
    app = typer.Typer()
    app.command()(command)
    folder = tmp_path / "keys"
    ask = ["--out", str(folder), "--client", "worker", "--client", "console"]
    assert CliRunner().invoke(app, ask).exit_code == 0
    before = contents(folder)
    again = CliRunner().invoke(app, ask)
    assert again.exit_code == 0
    assert "already" in again.output
    assert contents(folder) == before
    (folder / "worker" / "client.key_secret").unlink()
    assert isinstance(CliRunner().invoke(app, ask).exception, KeysError)
