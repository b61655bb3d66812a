"""Who may come in, for all sockets of a context that use keys (tracker_bridge/access.py)."""

from __future__ import annotations

import threading

import zmq

from entoptic.tracker_bridge.access import ZAP_ADDRESS, ServerKeys, zap_reply


class Authenticator:
    """Answers libzmq from a thread of its own until the context ends. To be made before any socket is bound."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], keys: ServerKeys) -> None:
        socket = context.socket(zmq.REP)
        socket.setsockopt(zmq.LINGER, 0)
        socket.bind(ZAP_ADDRESS)
        self._thread = threading.Thread(target=self._serve, args=(socket, keys), name="authenticator", daemon=True)
        self._thread.start()

    @staticmethod
    def _serve(socket: zmq.Socket[bytes], keys: ServerKeys) -> None:
        try:
            while True:
                socket.send_multipart(zap_reply(socket.recv_multipart(), keys))
        except zmq.ContextTerminated:
            pass
        finally:
            # Whatever happens: the context waits for its sockets to be closed.
            socket.close(linger=0)

    def join(self) -> None:
        """Waits for the thread; once the context is being ended."""
        self._thread.join()
