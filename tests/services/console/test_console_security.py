"""Who may come in: host names, origins, tokens, paths and sizes, by real requests to a real server."""

import contextlib
import http.client
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from console_session import PATIENCE_S, TOKEN, Served, Visitor
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from entoptic.services import web_server
from entoptic.services.console.access import ConsoleError, places, rules_for
from entoptic.services.console.live import Places
from entoptic.services.console.security import Rules
from entoptic.services.live.web import Web
from entoptic.services.process_config import PageConfig

Headers = dict[str, str]


def get(served: Served, path: str, method: str = "GET", **headers: str) -> tuple[int, Headers, bytes]:
    """A request as it is written, without a client's tidying up of paths."""
    connection = http.client.HTTPConnection("127.0.0.1", served.server.port, timeout=PATIENCE_S)
    with contextlib.closing(connection):
        connection.putrequest(method, path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        response = connection.getresponse()
        return response.status, {name.lower(): value for name, value in response.getheaders()}, response.read()


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with contextlib.closing(Served(tmp_path_factory.mktemp("open"), Places("tcp://127.0.0.1:9"))) as served:
        yield served


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder, nowhere = tmp_path_factory.mktemp("guarded"), Places("tcp://127.0.0.1:9")
    with contextlib.closing(Served(folder, nowhere, token=TOKEN, hosts=("console.example",))) as served:
        yield served


def visit(served: Served, **headers: str) -> contextlib.AbstractContextManager[Visitor]:
    @contextlib.contextmanager
    def visited() -> Iterator[Visitor]:
        origin = headers.pop("Origin", f"http://{served.at}")
        with connect(f"ws://{served.at}/live", origin=origin or None, additional_headers=headers) as socket:  # type: ignore[arg-type]
            yield Visitor(socket)

    return visited()


def refused(served: Served, **headers: str) -> int:
    with pytest.raises(InvalidStatus) as caught, visit(served, **headers):
        pass
    return caught.value.response.status_code


def test_browsers_are_told_to_keep_to_this_page(console: Served) -> None:
    status, headers, body = get(console, "/")
    assert status == 200
    assert b"Entoptic" in body
    assert headers["content-security-policy"].startswith("default-src 'self'")
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["x-frame-options"] == "DENY"
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cache-control"] == "no-store"
    assert headers["referrer-policy"] == "no-referrer"
    assert "server" not in headers
    for path in ("/no-such-page", "/sessions/none/report.html", "/health"):
        assert "content-security-policy" in get(console, path)[1], path


@pytest.mark.parametrize("name", ["evil.example", "127.0.0.1.evil.example", "192.168.1.5", "", "localhost.evil", "[:"])
def test_another_name_is_not_answered(console: Served, name: str) -> None:
    assert get(console, "/", Host=name)[0] in (400, 421)


@pytest.mark.parametrize("name", ["localhost", "127.0.0.1", "[::1]", "LOCALHOST"])
def test_this_machine_has_several_names(console: Served, name: str) -> None:
    assert get(console, "/", Host=f"{name}:{console.server.port}")[0] == 200


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example", "null", "", "http://127.0.0.1", "http://127.0.0.1:1", "http://localhost:{port}",
        "http://[x", "http://", "ftp://127.0.0.1:{port}",
    ],
)  # fmt: skip
def test_a_foreign_page_gets_no_socket(console: Served, origin: str) -> None:
    assert refused(console, Origin=origin.format(port=console.server.port)) == 403


def test_a_foreign_page_changes_and_reads_nothing(console: Served) -> None:
    for origin in ("http://evil.example", "http://[x"):
        assert get(console, "/health", Origin=origin)[0] == 403
    for method in ("POST", "PUT", "DELETE", "PATCH", "OPTIONS"):
        assert get(console, "/", method, Content_Length="0")[0] == 405
    with (
        pytest.raises(InvalidStatus) as caught,
        socket.create_connection(("127.0.0.1", console.server.port)) as raw,
        connect("ws://evil.example/live", sock=raw, origin="http://evil.example"),  # type: ignore[arg-type]
    ):
        pass
    assert caught.value.response.status_code == 403


def test_without_the_token_nobody_comes_in(guarded: Served) -> None:
    wrong = f"entoptic_console_{guarded.server.port}=wrong"
    for path in ("/", "/main.js", "/sessions/a/report.html", "/screens/", "/?token=", "/?token=wrong"):
        assert get(guarded, path)[0] == 401, path
        assert get(guarded, path, Cookie=wrong)[0] == 401, path
    assert get(guarded, "/", Cookie="a=\x01;;=")[0] in (400, 401)
    assert refused(guarded) == 403
    assert refused(guarded, Cookie=wrong) == 403
    assert get(guarded, "/health")[0] == 200


def test_the_token_is_given_once_and_kept_from_scripts_and_other_sites(guarded: Served) -> None:
    status, headers, _ = get(guarded, f"/?token={TOKEN}&tab=plan")
    assert status == 303
    assert headers["location"] == "/?tab=plan"
    cookie = headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    kept = cookie.split(";")[0]
    assert get(guarded, "/", Cookie=kept)[0] == 200
    with visit(guarded, Cookie=kept) as page:
        page.until("hello")
    assert get(guarded, f"//evil.example/?token={TOKEN}")[1]["location"] == "/evil.example/"


def test_beyond_loopback_names_must_be_known_and_numbers_are(guarded: Served) -> None:
    kept = f"entoptic_console_{guarded.server.port}={TOKEN}"
    assert get(guarded, "/", Cookie=kept, Host="evil.example")[0] == 421
    for name in ("console.example", "192.168.1.5:8080"):
        assert get(guarded, "/", Cookie=kept, Host=name)[0] == 200


@pytest.mark.parametrize("prefix", ["/", "/sessions/", "/sessions/take/", "/screens/"])
@pytest.mark.parametrize(
    "way",
    [
        "../secret.txt", "../../secret.txt", "%2e%2e/secret.txt", "..%2fsecret.txt", "%2e%2e%2fsecret.txt",
        "..%5csecret.txt", "....//secret.txt", "%252e%252e/secret.txt", "//etc/passwd", "%2fetc%2fpasswd",
        "take/../../secret.txt", "secret.txt%00", ".hidden/secret.txt", "link/secret.txt", "secret.txt",
    ],
)  # fmt: skip
def test_no_path_leads_out(console: Served, prefix: str, way: str) -> None:
    (console.root.parent / "secret.txt").write_text("secret")
    (console.root / "secret.txt").write_text("secret")  # beside sessions, but of none
    take = console.root / "take"
    (take / ".hidden").mkdir(parents=True, exist_ok=True)
    (take / "session.json").write_text("{}")
    (take / ".hidden" / "secret.txt").write_text("secret")
    if not (take / "link").is_symlink():
        (take / "link").symlink_to(console.root.parent)
    status, _, body = get(console, prefix + way)
    assert status in (400, 404), body
    assert b"secret" not in body


def test_what_sessions_left_can_be_read_but_runs_no_scripts(console: Served) -> None:
    take = console.root / "take"
    (take / "key_frames").mkdir(parents=True, exist_ok=True)
    for name in ("session.json", "report.html", "perceived.mp4", "key_frames/1.png"):
        (take / name).write_bytes(b"0123456789")
    for name in ("session.json", "report.html", "key_frames/1.png"):
        status, headers, body = get(console, f"/sessions/take/{name}")
        assert (status, body) == (200, b"0123456789")
        assert headers["content-security-policy"].startswith("default-src 'none'")
        assert "script-src" not in headers["content-security-policy"]
    status, _, body = get(console, "/sessions/take/perceived.mp4", Range="bytes=2-4")
    assert (status, body) == (206, b"234")


def test_long_requests_are_refused(console: Served) -> None:
    assert get(console, "/", Content_Length="70000")[0] == 413
    assert get(console, "/", Content_Length="9" * 400)[0] in (400, 413)
    assert get(console, "/", Transfer_Encoding="chunked")[0] == 413
    assert get(console, "/" + "a" * 100_000)[0] in (400, 404, 414)
    with socket.create_connection(("127.0.0.1", console.server.port), PATIENCE_S) as raw:
        raw.sendall(b"\x16\x03\x01\x00nonsense\r\n\r\n")
        assert b"400" in raw.recv(1000)
    assert get(console, "/health")[0] == 200


def test_a_connection_that_asks_for_nothing_is_cut(console: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(web_server, "FIRST_REQUEST_S", 0.3)
    with (
        visit(console) as page,
        socket.create_connection(("127.0.0.1", console.server.port), PATIENCE_S) as silent,
        socket.create_connection(("127.0.0.1", console.server.port), PATIENCE_S) as halting,
    ):
        halting.sendall(b"GET / HTTP/1.1\r\nHost:")
        for one in (silent, halting):
            with contextlib.suppress(ConnectionResetError):
                assert one.recv(1) == b""
        page.until("hello")
        assert page.ask("list", what="scenes")["done"]


def test_beyond_loopback_a_token_is_made_or_asked_for(tmp_path: Path) -> None:
    rules, made = rules_for("127.0.0.1", None, (), no_token=False, may_make=True)
    assert (rules(1).token, made) == (None, None)
    rules, made = rules_for("0.0.0.0", None, (), no_token=False, may_make=True)
    assert made is not None
    assert len(made) > 40
    assert rules(1).token == made
    assert rules_for("0.0.0.0", None, (), no_token=False, may_make=True)[1] != made
    with pytest.raises(ConsoleError, match="give --token"):
        rules_for("0.0.0.0", None, (), no_token=False, may_make=False)
    rules, made = rules_for("0.0.0.0", None, ("Console.Example",), no_token=True, may_make=False)
    assert rules(1) == Rules(None, ("console.example",), 1)
    (file := tmp_path / "token").write_text(TOKEN + "\n")
    assert rules_for("0.0.0.0", str(file), (), no_token=False, may_make=False)[0](1).token == TOKEN
    assert rules_for("0.0.0.0", TOKEN, (), no_token=False, may_make=False)[0](1).token == TOKEN
    for missing in (str(tmp_path / "no-such-file-of-a-token"), "token-that-is-not-there.txt"):
        with pytest.raises(ConsoleError, match="no such file"):
            rules_for("127.0.0.1", missing, (), no_token=False, may_make=True)
    for bad in ("short", "with blanks and more of them", "ümläute-ümläute-ümläute"):
        with pytest.raises(ConsoleError, match="letters and digits"):
            rules_for("127.0.0.1", bad, (), no_token=False, may_make=True)


def test_a_host_passes_on_by_what_names_its_console_may_be_called() -> None:
    web = Web(PageConfig(port=0, names=("console.example", "lab"))).settled()
    config = web.config("tcp://127.0.0.1:2")
    assert config.page.names == ("console.example", "lab")
    assert config.page.port > 0
    assert config.links.host_control == "tcp://127.0.0.1:2"


def test_a_host_or_all_addresses() -> None:
    given: dict[str, str | None] = dict.fromkeys(
        ("states", "events", "bridge", "screens", "answers", "frames", "worker"), "tcp://127.0.0.1:1"
    )
    assert places("tcp://127.0.0.1:2", dict.fromkeys(given), None, None).host_control == "tcp://127.0.0.1:2"
    attached = places(None, given, None, None)
    assert attached.addresses is not None
    with pytest.raises(ConsoleError, match="--frames missing"):
        places(None, given | {"frames": None}, None, None)
    with pytest.raises(ConsoleError, match="leave the other addresses out"):
        places("tcp://127.0.0.1:2", given, None, None)
