"""What a live worker publishes, for as many programs as want it: each thing is made only while somebody subscribes to it.

Theory of operation: one XPUB socket. Its queue for each reader is short and a full one is passed over, so whoever reads
slowly misses messages, and nobody else notices. What is subscribed is looked at once a frame; a new subscriber of
`kernel` gets the kernels anew, which are otherwise sent only when they change.
"""

from __future__ import annotations

from collections.abc import Sequence

import zmq

from services.live.messages import LatencyMs
from services.results import Rendered
from services.settings import Settings
from tracker_bridge.access import ServerKeys
from tracker_bridge.wire import Eye


class LivePublisher:
    """Publishes frames. All methods are for one thread.

    Raises PortInUseError, and OpenAddressError for an address that is not local unless there are keys.
    """

    def __init__(self, address: str, keys: ServerKeys | None = None) -> None:
        raise NotImplementedError

    @property
    def context(self) -> zmq.Context[zmq.Socket[bytes]]:
        """For further sockets of the worker, which the same keys guard; to be closed before this one is."""
        raise NotImplementedError

    @property
    def address(self) -> str:
        """Where it is to be had."""
        raise NotImplementedError

    @property
    def viewers(self) -> int:
        """How many readers are connected."""
        raise NotImplementedError

    def wants(self, topic: bytes) -> bool:
        """Whether somebody subscribed to it."""
        raise NotImplementedError

    def show(
        self,
        rendered: Rendered,
        eyes: Sequence[Eye],
        settings: Settings,
        *,
        t_ns: int,
        fps: float,
        reached_fps: float,
        dropped: int,
        latency: LatencyMs | None,
        sink_ms: float,
        take: str | None,
        trouble: str | None,
    ) -> None:
        """Makes and sends what is wanted of a frame; does not wait. To be called once for each frame.

        `eyes` are those of the frame's images, `t_ns` is when it was begun, `sink_ms` what keeping it took.
        """
        raise NotImplementedError

    def close(self) -> None:
        """Closes the socket; what is queued has 0.2 s to leave."""
        raise NotImplementedError
