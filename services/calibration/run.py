"""Runs the black and white screens before a person, or simulated eyes: a run that a source's items step.

Nothing is judged here: see outcome.py. pupil_calibration.py owns the runs before one display.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import msgspec

from entoptic.services.calibration.display import Display, Request, ScreenShown
from entoptic.services.config import CalibrationConfig, CalibrationProtocol, Eyes
from entoptic.tracker_bridge import calibration as protocols
from entoptic.tracker_bridge.calibration import SHOWN_WITHIN_NS, Calibration, Commands, Screen, ShownScreen, Stage
from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item

GREY_SHARE = 0.2159
"""Luminance of sRGB's middle grey, #808080, of white's (IEC 61966-2-1)."""
_NO_ANSWER = "The display does not answer when it is asked for its time. Look whether it is connected, and start again."


class Lit(Protocol):
    """Eyes that answer to light."""

    def set_luminance(self, luminance_cd_m2: float, t_ns: int) -> None:
        """The light before them from a time on."""
        ...


@dataclasses.dataclass(frozen=True)
class Room:
    """A display before simulated eyes: their light follows the screens. Without eyes, a display before a person."""

    display: Display
    eyes: Lit | None = None
    white_cd_m2: float = 200.0
    black_cd_m2: float = 0.05

    def light(self, screen: Screen, t_ns: int) -> None:
        """A screen was shown."""
        if self.eyes is not None:
            luminances = {Screen.WHITE: self.white_cd_m2, Screen.BLACK: self.black_cd_m2}
            self.eyes.set_luminance(luminances.get(screen, self.white_cd_m2 * GREY_SHARE), t_ns)


class Recorded(msgspec.Struct, frozen=True):
    """All that a run leaves, before anybody has judged it."""

    protocol: protocols.Protocol
    eyes: tuple[Eye, ...]
    """Which must succeed."""
    stage: Stage
    screens: tuple[ShownScreen, ...]
    samples: list[PupilSample]


class CalibrationRun:
    """One run of a protocol, from when the person starts it. Reads no clock; all that it does is said to the display.

    `ids` numbers the screens; runs before one display share it, so that none takes an old answer for its own.
    """

    def __init__(
        self,
        protocol: protocols.Protocol,
        room: Room,
        eyes: Sequence[Eye] = tuple(Eye),
        ids: Iterator[int] | None = None,
    ) -> None:
        self.protocol = protocol
        self._calibration = Calibration(protocol, ids)
        self._room = room
        self._eyes = tuple(eyes)
        self._asked: dict[int, Screen] = {}
        self._wants_start_ns: int | None = None

    def step(self, item: Item, now_ns: int) -> None:
        """One more item of the source, at a time of the bridge's clock: what of it the screens' routine wants."""
        if isinstance(item, GazeSample) or self.is_over:
            return
        for answer in self._room.display.answers(now_ns):
            self._handle(answer, now_ns)
        if self._wants_start_ns is not None:
            self._start(now_ns, self._wants_start_ns)
        if isinstance(item, PupilSample):
            self._calibration.sample(item)
        self._show(self._calibration.advance(now_ns))

    def abort(self) -> None:
        """Ends it without a result."""
        self._show(self._calibration.abort())

    @property
    def stage(self) -> Stage:
        """Where it is."""
        return self._calibration.stage

    @property
    def is_over(self) -> bool:
        """Whether nothing more is going to happen."""
        return self.stage.is_final

    def status(self, now_ns: int) -> dict[str, Any]:
        """How far it is. `step`: which screen it is at, from 1; 0 before the first."""
        one, steps = self._calibration, self.protocol.steps
        is_on = one.stage in (Stage.WAITING, Stage.SHOWING)
        return {
            "stage": one.stage.value,
            "screen": (one.step.screen if is_on else Screen.GREY).value,
            "step": 0 if one.stage is Stage.READY else min(len(one.shown_screens) + 1, len(steps)),
            "steps": len(steps),
            "seconds_done": one.seconds_done(now_ns),
            "seconds": self.protocol.seconds,
        }

    def recorded(self) -> Recorded:
        """What it leaves."""
        one = self._calibration
        return Recorded(self.protocol, self._eyes, one.stage, tuple(one.shown_screens), one.samples)

    def _handle(self, answer: ScreenShown | Request, now_ns: int) -> None:
        if isinstance(answer, ScreenShown):
            self._calibration.shown(answer.id, answer.t_ns, now_ns)
            if answer.id in self._asked:
                self._room.light(self._asked.pop(answer.id), answer.t_ns)
        elif answer is Request.ABORT:
            self.abort()
        elif answer is Request.PAUSE:
            self._wants_start_ns = None
            self._show(self._calibration.pause())
        else:
            self._wants_start_ns = now_ns

    def _start(self, now_ns: int, since_ns: int) -> None:
        """As soon as the display's clock is known; whoever starts shall not see it begin by itself much later."""
        if self._room.display.ready:
            self._wants_start_ns = None
            begin = self._calibration.resume if self.stage is Stage.PAUSED else self._calibration.start
            self._show(begin(now_ns))
        elif now_ns - since_ns > SHOWN_WITHIN_NS:
            self._wants_start_ns = None
            self._room.display.tell(_NO_ANSWER, again=True)

    def _show(self, commands: Commands) -> None:
        for command in commands:
            self._asked[command.id] = command.screen
            self._room.display.show(command)


def protocol_of(config: CalibrationConfig) -> protocols.Protocol:
    """Its protocol, the screens as long as given. Raises CalibrationError."""
    make = {CalibrationProtocol.ROBUST: protocols.robust, CalibrationProtocol.LUIDOLT: protocols.luidolt}
    given = {"white_s": config.white_s, "black_s": config.black_s}
    return make[config.protocol](**{name: value for name, value in given.items() if value is not None})


def eyes_of(config: CalibrationConfig) -> tuple[Eye, ...]:
    """Which eyes must succeed."""
    return {Eyes.LEFT: (Eye.LEFT,), Eyes.RIGHT: (Eye.RIGHT,)}.get(config.eyes, tuple(Eye))
