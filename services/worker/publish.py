"""What a live worker publishes, for any number of programs: each thing is made only while somebody subscribes to it.

Theory of operation: one XPUB socket. Its queue for each reader is short and a full one is passed over, so whoever reads
slowly misses messages, and nobody else notices. What is subscribed is looked at once a frame; a new subscriber of
`kernel` gets the kernels again, which are otherwise sent only when they change, and before the frame that uses them.

Memory: for a reader that has stalled QUEUE messages, which it shares with others that stalled at the same time, beside
what the kernel buffers for a connection.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import zmq
from zmq.utils.monitor import recv_monitor_message

from entoptic.pipeline import Display, as_displayed
from entoptic.pipeline.effects.glare import GLARE
from entoptic.services.ipc import messages
from entoptic.services.ipc.messages import EyeShown, LatencyMs, Picture, Shown, StepShown
from entoptic.services.rendering import Rendered
from entoptic.services.results.frames import side_by_side
from entoptic.services.settings import Settings
from entoptic.services.worker import engine
from entoptic.tracker_bridge.access import Authenticator, OpenAddressError, ServerKeys, is_local
from entoptic.tracker_bridge.publisher import KEEPALIVE, PortInUseError, bind
from entoptic.tracker_bridge.wire import Eye

QUEUE = 12
"""Messages kept for each reader. Engineering choice: libzmq learns of what was sent half a queue late, so this holds
all messages of a frame, two kernels among them, for a reader that keeps up."""
MAX_SUBSCRIPTION_BYTES = 1024
"""Nobody has more to say to a publisher; a connection that sends a longer message is closed."""
SUBSCRIPTIONS_AT_ONCE = 1000
"""Subscriptions taken in at once: whoever subscribes without end holds no frame up for long."""
LINGER_MS = 200
"""What is queued at the end has so long to leave."""


class LivePublisher:
    """Publishes frames. All methods are for one thread.

    Raises PortInUseError, and OpenAddressError for an address that is not local unless there are keys.
    """

    def __init__(self, address: str, keys: ServerKeys | None = None) -> None:
        if keys is None and not is_local(address):
            raise OpenAddressError(
                f"{address} can be reached from other machines, and whoever connects there could see what this person "
                "sees: make keys with `entoptic keys --out keys` and give the worker --server-keys keys/bridge, or "
                "listen on this machine alone, tcp://127.0.0.1:*"
            )
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._authenticator = None if keys is None else Authenticator(self._context, keys)
        self._socket = self._context.socket(zmq.XPUB)
        for option, value in (
            *KEEPALIVE,
            (zmq.XPUB_VERBOSE, 1),
            (zmq.SNDHWM, QUEUE),
            (zmq.MAXMSGSIZE, MAX_SUBSCRIPTION_BYTES),
            (zmq.LINGER, LINGER_MS),
        ):
            self._socket.setsockopt(option, value)
        if keys is not None:
            keys.use(self._socket)
        self._connections = self._socket.get_monitor_socket(zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
        try:
            bind(self._socket, address)
        except PortInUseError:
            self.close()
            raise
        self._connected: set[int] = set()
        self._topics: dict[bytes, set[bytes]] = {topic: set() for topic in messages.TOPICS}
        """Of each topic: the prefixes of it that are subscribed."""
        self._kernels_again = False
        # A worker that is started again gives other numbers: a reader may still have the last one's kernels.
        self._numbers = engine.KernelNumbers(time.monotonic_ns() // 1_000_000)
        self._sent: dict[Eye, int] = {}
        """The numbers of the kernels that were sent last."""

    @property
    def context(self) -> zmq.Context[zmq.Socket[bytes]]:
        """For further sockets of the worker, which the same keys guard; to be closed before this one is."""
        return self._context

    @property
    def address(self) -> str:
        """Where it is to be had."""
        return self._socket.getsockopt_string(zmq.LAST_ENDPOINT)

    @property
    def viewers(self) -> int:
        """How many readers are connected, as of the last frame."""
        return len(self._connected)

    def wants(self, topic: bytes) -> bool:
        """Whether somebody had subscribed to it at the last frame."""
        return bool(self._topics[topic])

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
        latency: Callable[[], LatencyMs | None],
        sink_ms: float,
        recording: str | None,
    ) -> None:
        """Makes and sends what is wanted of a frame; does not wait. To be called once for each frame.

        `eyes` are those of the frame's images, `t_ns` is when it was begun, `latency` is what it is by now, `sink_ms`
        what keeping it took.
        """
        self.take_subscriptions()
        display = settings.display
        milliseconds = {"scene": rendered.scene_ms, **{str(k): v for k, v in rendered.perceived.milliseconds.items()}}
        if self.wants(messages.PERCEIVED):
            self._send(messages.PERCEIVED, picture(rendered.perceived.image, rendered, display, t_ns))
        if self.wants(messages.DISPLAYED):
            begun = time.perf_counter()
            displayed = as_displayed(rendered.frame, display)
            milliseconds["displayed"] = (time.perf_counter() - begun) * 1e3
            self._send(messages.DISPLAYED, picture(displayed, rendered, display, t_ns))
        if self.wants(messages.KERNEL) or self.wants(messages.ENGINE):
            self._show_engine(rendered, eyes, settings, t_ns)
        if self.wants(messages.SHOWN):
            self._send(
                messages.SHOWN,
                Shown(
                    frame=rendered.frame_number,
                    t_s=rendered.t_s,
                    t_ns=t_ns,
                    width_px=rendered.frame.view.width_px,
                    height_px=rendered.frame.view.height_px,
                    eyes=tuple(eye_shown(rendered, k, eye) for k, eye in enumerate(eyes)),
                    plan=_plan_shown(rendered),
                    bound_code_values=rendered.perceived.plan.bound_code_values,
                    milliseconds={**milliseconds, "sink": sink_ms},
                    budget_ms=settings.plan.budget_ms,
                    fps=fps,
                    reached_fps=reached_fps,
                    dropped=dropped,
                    latency=latency(),
                    recording=recording,
                ),
            )

    def _show_engine(self, rendered: Rendered, eyes: Sequence[Eye], settings: Settings, t_ns: int) -> None:
        kernels = [GLARE.prepared(one).kernel for one in rendered.perceived.eyes]
        runs = rendered.perceived.plan[GLARE.name].runs
        numbers = [
            self._numbers.number(eye, kernel, t_ns) if runs else 0 for eye, kernel in zip(eyes, kernels, strict=True)
        ]
        if self.wants(messages.KERNEL):
            for eye, held in self._numbers.held.items():
                if self._kernels_again or self._sent.get(eye) != held.number:
                    kernel = engine.engine_kernel(held, eye, rendered.frame.view.ppd_centre)
                    self._send(messages.KERNEL, kernel)
                    self._sent[eye] = held.number
            self._kernels_again = False
        if self.wants(messages.ENGINE):
            frame = engine.engine_frame(rendered, eyes, settings, settings.display, numbers, t_ns)
            self._send(messages.ENGINE, frame)

    def take_subscriptions(self) -> None:
        """Takes in who came, went and subscribed; `show` does so too."""
        for _ in range(SUBSCRIPTIONS_AT_ONCE):
            if not self._socket.poll(0, zmq.POLLIN):
                break
            self._note(self._socket.recv())
        for _ in range(SUBSCRIPTIONS_AT_ONCE):
            if not self._connections.poll(0):
                break
            happened = recv_monitor_message(self._connections)
            if happened["event"] == zmq.EVENT_ACCEPTED:
                self._connected.add(happened["value"])
            else:
                self._connected.discard(happened["value"])

    def _note(self, subscription: bytes) -> None:
        kind, prefix = subscription[:1], subscription[1:]
        for topic, prefixes in self._topics.items():
            if not topic.startswith(prefix):
                continue
            if kind == b"\x01":
                prefixes.add(prefix)
                self._kernels_again |= topic == messages.KERNEL
            elif kind == b"\x00":
                prefixes.discard(prefix)

    def _send(self, topic: bytes, body: msgspec.Struct) -> None:
        # Large messages are not copied once more.
        self._socket.send_multipart([topic, messages.encode(body)], zmq.DONTWAIT, copy=False)

    def close(self) -> None:
        """Closes the socket; what is queued has 0.2 s to leave."""
        self._socket.disable_monitor()
        self._connections.close(0)
        self._socket.close()
        self._context.term()
        if self._authenticator is not None:
            self._authenticator.join()


def picture(image: np.ndarray, rendered: Rendered, display: Display, t_ns: int) -> Picture:
    """A frame's images (eye, y, x, 3) as one picture."""
    pixels = side_by_side(image)
    height, width, _ = pixels.shape
    return Picture(
        frame=rendered.frame_number,
        t_ns=t_ns,
        width_px=width,
        height_px=height,
        encoding=display.encoding.value,
        dtype=pixels.dtype.name,
        pixels=pixels.astype(pixels.dtype.newbyteorder("<"), copy=False).tobytes(),
    )


def eye_shown(rendered: Rendered, k: int, eye: Eye) -> EyeShown:
    """One eye's figures."""
    perceived, pose, view = rendered.perceived, rendered.poses[k], rendered.frame.view
    gaze_px = view.pixel_of(pose.azimuth_deg, pose.elevation_deg)
    return EyeShown(
        eye=eye.name.lower(),
        phase="none" if rendered.state is None else rendered.state.of(eye).phase.value,
        gaze_deg=(pose.azimuth_deg, pose.elevation_deg),
        gaze_px=gaze_px,
        pupil_diameter_mm=perceived.pupil_diameter_mm[k],
        openness=pose.openness,
        adapted_cd_m2=perceived.state.adapted_cd_m2[k],
        mean_cd_m2=perceived.measured[k].mean_cd_m2,
        max_cd_m2=perceived.measured[k].max_cd_m2,
    )


def _plan_shown(rendered: Rendered) -> tuple[StepShown, ...]:
    perceived = rendered.perceived
    return tuple(
        StepShown(
            effect=step.effect,
            level=step.level,
            runs=step.runs,
            reason=step.reason,
            bound_code_values=step.bound_code_values,
            ms=perceived.milliseconds.get(step.effect, 0.0),
            fading_from=step.fading_from,
            fade=step.fade,
        )
        for step in perceived.plan
    )
