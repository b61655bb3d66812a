"""Asks a running process for something, and takes its reply: at once, or by and by.

One request, one reply, each a msgpack map of one part: `{"do": "start recording", "name": "…"}` is answered by
`{"done": true, "reply": "…"}`. What each process understands is in requests.py.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from typing import Any, Self, TypeAlias

import msgspec
import zmq

from entoptic.errors import EntopticError
from entoptic.tracker_bridge.access import ClientKeys

Context: TypeAlias = "zmq.Context[zmq.Socket[bytes]]"
PATIENCE_MS = 2000
"""Every process answers between two samples, or from a thread of its own."""
POLL_S = 0.01
"""Between two looks for a reply, where other work of the same thread must not wait."""


class Reply(msgspec.Struct, frozen=True):
    """Whether it is done."""

    done: bool
    reply: str
    """For a person: what was done, or why not and what to do."""
    data: Any = None
    """For a program; of a status, the record."""


class ControlError(EntopticError):
    """A process cannot be asked: the message names it and the remedy."""


class Client:
    """Requests to one process, one at a time: a new one cancels the one that is still unanswered.

    A process that is not there yet is asked as soon as it is. Raises ControlError for an address that is none.
    """

    def __init__(self, address: str, keys: ClientKeys | None = None, context: Context | None = None) -> None:
        self.address = address
        self.request: msgspec.Struct | None = None
        """The one that has no reply yet."""
        self.sent_s = time.monotonic()
        self._own: Context | None = zmq.Context() if context is None else None
        self._socket = (context or self._own or zmq.Context()).socket(zmq.REQ)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.REQ_RELAXED, 1),
            (zmq.REQ_CORRELATE, 1),
            (zmq.RECONNECT_IVL, 50),
            (zmq.RECONNECT_IVL_MAX, 200),
        ):
            self._socket.setsockopt(option, value)
        if keys is not None:
            keys.use(self._socket)
        try:
            self._socket.connect(address)
        except zmq.ZMQError as error:
            self.close()
            raise ControlError(f"cannot connect to {address}: {error.strerror}") from None

    def send(self, request: msgspec.Struct) -> None:
        """Does not wait."""
        self.request, self.sent_s = request, time.monotonic()
        self._socket.send(msgspec.msgpack.encode(request))

    def poll(self, wait_ms: int = 0) -> Reply | None:
        """The reply, None while there is none. Raises ControlError where it cannot be read."""
        until_s = time.monotonic() + wait_ms / 1e3
        while self.request is not None and self._socket.poll(max(int((until_s - time.monotonic()) * 1e3), 0)):
            with contextlib.suppress(zmq.Again):  # it was the late reply to an earlier request
                message = self._socket.recv(zmq.DONTWAIT)
                self.request = None
                try:
                    return msgspec.msgpack.decode(message, type=Reply)
                except (msgspec.DecodeError, UnicodeDecodeError) as error:
                    raise ControlError(f"{self.address} does not speak Entoptic's protocol: {error}") from None
        return None

    def ask(self, request: msgspec.Struct, patience_ms: int = PATIENCE_MS) -> Reply:
        """Waits for the reply, be it a refusal. Raises ControlError where none comes."""
        self.send(request)
        if (reply := self.poll(patience_ms)) is None:
            raise self._silent()
        return reply

    async def ask_async(self, request: msgspec.Struct, patience_ms: int = PATIENCE_MS) -> Reply:
        """The same in an event loop, which goes on meanwhile."""
        self.send(request)
        while (reply := self.poll()) is None:
            if time.monotonic() - self.sent_s > patience_ms / 1e3:
                raise self._silent()
            await asyncio.sleep(POLL_S)
        return reply

    def _silent(self) -> ControlError:
        return ControlError(f"nobody answers at {self.address}: give the address that the process logs as `control`")

    def close(self) -> None:
        """Awaits nothing any more."""
        self._socket.close()
        if self._own is not None:
            self._own.destroy(linger=0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def ask(
    address: str, request: msgspec.Struct, keys: ClientKeys | None = None, *, patience_ms: int = PATIENCE_MS
) -> Reply:
    """Sends one request; the reply, be it a refusal. Raises ControlError where none comes."""
    with Client(address, keys) as client:
        return client.ask(request, patience_ms)


def tell(address: str, request: msgspec.Struct, keys: ClientKeys | None = None) -> Reply:
    """The same; raises ControlError where it is not done, with the process's own words."""
    reply = ask(address, request, keys)
    if not reply.done:
        raise ControlError(reply.reply)
    return reply
