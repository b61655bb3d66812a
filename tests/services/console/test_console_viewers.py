"""Pages that are many, slow or dead cost what they may cost, and no more."""

import asyncio
import socket
from collections.abc import Callable

import pytest
from console_session import PATIENCE_S, MadeUpSession, Served, wait_for
from websockets.sync.client import connect

from entoptic.services.console import viewers
from entoptic.services.console.live import Places
from entoptic.services.console.protocol import DISPLAYED, PERCEIVED, picture
from entoptic.services.console.viewers import QUEUE_BYTES, Page, Viewers


def test_a_page_that_takes_nothing_is_given_bounded_memory() -> None:
    page = Page(lambda: None)
    for number in range(10_000):
        page.queue([b"%06d" % number + b" " * 1000])
        page.newest("status", b" " * 5000)
        page.picture(PERCEIVED, b" " * 50_000)
    assert page.waiting_bytes < QUEUE_BYTES + 60_000


def test_what_is_given_up_is_the_oldest_and_order_is_kept() -> None:
    sent: list[str] = []

    async def send(text: str) -> None:
        sent.append(text)

    async def run() -> None:
        page = Page(lambda: None)
        page.queue([b"%07d" % number for number in range(QUEUE_BYTES // 7 + 100)])
        page.end(b'"bye"')
        await page.send(send, send, lambda: 0.0)  # type: ignore[arg-type]

    asyncio.run(run())
    (text,) = sent
    said = text.strip("[]").split(",")
    assert said[0] == "0000101" or int(said[0]) >= 100
    assert said[-2:] == [f"{QUEUE_BYTES // 7 + 99:07d}", '"bye"']
    assert said[:-1] == sorted(said[:-1])


def test_a_page_that_takes_nothing_is_cut_off() -> None:
    cut: list[bool] = []

    async def stuck(text: str | bytes) -> None:
        await asyncio.sleep(60)

    async def run() -> None:
        page = Page(lambda: cut.append(True))
        page.queue([b"{}"])
        await page.send(stuck, stuck, lambda: 0.0, patience_s=0.05)

    asyncio.run(run())
    assert cut == [True]


def test_the_budget_is_shared_out() -> None:
    all_pages = Viewers()

    def rates(count: int) -> tuple[float, float]:
        while len(all_pages) < count:
            all_pages.add(Page(lambda: None))
        return count / all_pages.pace_s(), sum(count / every_s for every_s in all_pages.wanted().values())

    texts, pictures = zip(*(rates(count) for count in (1, 4, 10, 50, 100)), strict=True)
    assert texts[0] == pytest.approx(25)
    assert pictures[0] == pytest.approx(30)
    assert max(texts) <= viewers.TEXTS_A_S + 1e-6
    assert max(pictures) <= max(viewers.PICTURES_A_S, 200 / viewers.RAREST_S) + 1e-6
    assert not all_pages.add(Page(lambda: None))
    for page in all_pages.pages:
        page.kinds = frozenset({DISPLAYED})
    all_pages.note()
    assert set(all_pages.wanted()) == {DISPLAYED}
    for page in list(all_pages.pages):
        all_pages.remove(page)
    assert all_pages.wanted() == {}


def test_a_picture_says_its_kind_and_frame() -> None:
    assert picture(PERCEIVED, 258, b"jpeg") == b"\x01\x00\x00\x01\x02jpeg"


def test_a_page_that_never_reads_is_closed_and_disturbs_no_other(
    serve: Callable[..., Served], session: MadeUpSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Page.send, "__defaults__", (1.0,))  # its patience
    session.frame_px = (1280, 960)
    served = serve(Places(None, session.addresses))
    raw = socket.socket()
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    raw.connect(("127.0.0.1", served.server.port))
    key = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
    raw.sendall(
        f"GET /live HTTP/1.1\r\nHost: {served.at}\r\nOrigin: http://{served.at}\r\nUpgrade: websocket\r\n"
        f"Connection: Upgrade\r\n{key}\r\n".encode()
    )
    with raw, served.page() as page:
        wait_for(lambda: len(served.console.live.viewers) == 2, "both pages")
        frames = []
        while len(served.console.live.viewers) == 2:
            frames.append(page.until("shown")["frame"])
            for one in served.console.live.viewers.pages:
                assert one.waiting_bytes < QUEUE_BYTES + 500_000
        page.until("shown", lambda message: message["frame"] > frames[-1] + 10)
        assert frames == sorted(frames)
        assert len(page.pictures) > 3


def test_too_many_pages_are_told_so(attached: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewers, "MOST_PAGES", 2)
    with (
        attached.page() as first,
        attached.page() as second,
        connect(f"ws://{attached.at}/live", origin=f"http://{attached.at}") as third,  # type: ignore[arg-type]
    ):
        first.until("hello")
        second.until("hello")
        with pytest.raises(Exception, match="close some"):
            third.recv(PATIENCE_S)
