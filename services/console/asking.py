"""Requests to other processes whose answers are awaited, as services.control.ask, without a thread for each."""

from __future__ import annotations

from typing import Any, cast

import msgspec
import zmq
import zmq.asyncio

from entoptic.services.control import PATIENCE_MS, ControlError, Reply
from entoptic.tracker_bridge.access import ClientKeys


class Asker:
    """For one event loop. Close it when nothing is asked any more."""

    def __init__(self) -> None:
        self._context = zmq.asyncio.Context()

    async def ask(
        self, address: str, request: msgspec.Struct, keys: ClientKeys | None = None, patience_ms: int = PATIENCE_MS
    ) -> Reply:
        """The answer, be it a refusal. Raises ControlError where none comes."""
        socket = None
        try:
            socket = self._context.socket(zmq.REQ)
            socket.setsockopt(zmq.LINGER, 0)
            if keys is not None:
                keys.use(cast(Any, socket))  # of the same options, though not of the same type
            socket.connect(address)
            await socket.send(msgspec.msgpack.encode(request))
            if not await socket.poll(patience_ms):
                raise ControlError(f"nobody answers at {address}: see that what should listen there runs")
            return msgspec.msgpack.decode(await socket.recv(), type=Reply)
        except zmq.ZMQError as error:
            raise ControlError(f"cannot connect to {address}: {error.strerror}") from None
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise ControlError(f"{address} is none of ours: {error}") from None
        finally:
            if socket is not None:
                socket.close()

    def close(self) -> None:
        """Asks no more."""
        self._context.destroy(linger=0)
