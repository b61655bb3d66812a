"""A display program of somebody else's, with a clock of its own, for tests of pupil calibrations."""

import queue
import threading
import time
from typing import Any, Self

import msgspec
import zmq

from entoptic.tracker_bridge.access import ClientKeys
from entoptic.tracker_bridge.samples import NS_PER_S


class ScreenProgram:
    """Shows every screen 10 ms after it is asked for, and says so."""

    def __init__(
        self, commands: str, answers: str, *, clock_ahead_ns: int = -3600 * NS_PER_S, keys: ClientKeys | None = None
    ) -> None:
        self.said: list[dict[str, Any]] = []
        """All that was said to it."""
        self.screens: list[tuple[int, str]] = []
        """Each screen shown: its number and colour."""
        self.shown_ns: dict[int, int] = {}
        """When, on this machine's clock."""
        self._addresses, self._ahead_ns, self._keys = (commands, answers), clock_ahead_ns, keys
        self._to_say: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def screen(self) -> str | None:
        """What it shows."""
        return self.screens[-1][1] if self.screens else None

    def told(self, words: str) -> bool:
        """Whether a sentence with these words was shown."""
        return any(words in message.get("message", "") for message in self.said)

    def say(self, message: dict[str, object] | bytes) -> None:
        """Sends a message, or what is none."""
        self._to_say.put(message if isinstance(message, bytes) else msgspec.msgpack.encode(message))

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        commands, answers = context.socket(zmq.SUB), context.socket(zmq.PUSH)
        for socket, address in zip((commands, answers), self._addresses, strict=True):
            if self._keys is not None:
                self._keys.use(socket)
            socket.connect(address)
        commands.subscribe(b"")
        while not self._over.is_set():
            while not self._to_say.empty():
                self._send(answers, self._to_say.get())
            if commands.poll(10):
                self._read(msgspec.msgpack.decode(commands.recv()), answers)
        context.destroy(linger=0)

    def _send(self, answers: zmq.Socket[bytes], message: bytes) -> None:
        """Whoever is let in nowhere can send nothing, and must still end."""
        while not self._over.is_set():
            if answers.poll(10, zmq.POLLOUT):
                answers.send(message)
                return

    def _read(self, message: dict[str, Any], answers: zmq.Socket[bytes]) -> None:
        self.said.append(message)
        if "ask" in message:
            self._send(
                answers,
                msgspec.msgpack.encode({"answer": message["ask"], "t_ns": time.monotonic_ns() + self._ahead_ns}),
            )
        elif "screen" in message:
            number = message["id"]
            if number not in self.shown_ns:
                time.sleep(0.01)
                self.shown_ns[number] = time.monotonic_ns()
                self.screens.append((number, message["screen"]))
            answer = {"shown": number, "t_ns": self.shown_ns[number] + self._ahead_ns}
            self._send(answers, msgspec.msgpack.encode(answer))
