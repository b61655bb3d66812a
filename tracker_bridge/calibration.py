"""The black and white screens that find out how far a person's pupils close and open.

Theory of operation: the routine asks a display for one screen after the other and keeps every sample that arrives
meanwhile; nothing is judged here (calibration_quality.py does that when all is over). A screen's time runs from when
the display says it was really shown, not from when it was asked for. Each screen has an id of its own: an answer to an
older one means nothing any more. A pause throws the present step away; resuming shows it again from its beginning.

It reads no clock and owns no socket: every call says what time it is, and returns the screens to ask for next.

| stage    | start   | shown, its id | advance: time is over | pause  | resume  | abort   |
|----------|---------|---------------|-----------------------|--------|---------|---------|
| READY    | WAITING | –             | –                     | –      | –       | ABORTED |
| WAITING  | –       | SHOWING       | NOT_SHOWN             | PAUSED | –       | ABORTED |
| SHOWING  | –       | –             | WAITING or ENDING     | PAUSED | –       | ABORTED |
| PAUSED   | –       | –             | –                     | –      | WAITING | ABORTED |
| ENDING   | –       | –             | FINISHED              | –      | –       | ABORTED |

FINISHED, NOT_SHOWN and ABORTED are final.
"""

from __future__ import annotations

import collections
import enum
import itertools
from collections.abc import Iterator

import msgspec

from entoptic.errors import EntopticError
from entoptic.tracker_bridge.samples import NS_PER_S, PupilSample

SHOWN_WITHIN_NS = 3 * NS_PER_S
"""A display that has not answered by then shows nothing. Engineering choice: many frames, and time to reconnect."""
LATE_SAMPLES_NS = 200_000_000
"""How long samples of the last screen may still be on their way. Engineering choice: twice what trackers need."""
PAUSED_SAMPLES = 2000
"""Kept of a pause, which may last for hours. Engineering choice: 2.5 s of both eyes at 400 Hz, so that whatever filters
them has found the pupil again before the next screen."""
USE_LAST_S = 4.0
"""How much of a screen's end is measured. Hippus has periods of seconds: of 200 simulated runs 2 to 8 % of those with
3 s of it were refused as drifting, of those with 4 s none."""
WHITE_S, BLACK_S = 8.0, 18.0
"""The slow half of the light reflex, fitted to measured responses in simulated/pupil.py, has time constants of 1.5 s
for constriction and 4 s for dilation: at the end of 5 s of white a pupil is still 0.01 mm too wide, of 10 s of black
0.13 mm too small; of these, 0.00 and 0.02 mm."""
LUIDOLT_S = 5.0
"""Of each screen (Luidolt 2020, 5.2.1 ii)."""
SECONDS_RANGE = (1.0, 120.0)


class CalibrationError(EntopticError):
    """A calibration cannot be run as asked for: the message says what is wrong and what to do."""


class Screen(enum.StrEnum):
    """What a display shows, all over and evenly."""

    WHITE = "white"
    """As bright as it goes."""
    BLACK = "black"
    """As dark as it goes."""
    GREY = "grey"
    """Before, after, and while the routine is paused."""


class Step(msgspec.Struct, frozen=True):
    """One screen of a protocol."""

    screen: Screen
    seconds: float
    use_last_s: float
    """How much of its end is measured."""


class Statistic(enum.StrEnum):
    """What a window's tracked diameters become."""

    MEDIAN = "median"
    MEAN = "mean"


class Protocol(msgspec.Struct, frozen=True):
    """Which screens, for how long, and how they are measured."""

    name: str
    steps: tuple[Step, ...]
    statistic: Statistic
    must_settle: bool
    """Whether a pupil that still moves within a window is refused."""

    @property
    def seconds(self) -> float:
        """All screens together."""
        return sum(step.seconds for step in self.steps)


def robust(white_s: float = WHITE_S, black_s: float = BLACK_S) -> Protocol:
    """White, black, white again; the median of the end of each. Raises CalibrationError."""
    _refuse_unless_in_range("robust", (white_s, black_s), USE_LAST_S + 1.0)
    white, black = Step(Screen.WHITE, white_s, USE_LAST_S), Step(Screen.BLACK, black_s, USE_LAST_S)
    return Protocol("robust", (white, black, white), Statistic.MEDIAN, must_settle=True)


def luidolt(white_s: float = LUIDOLT_S, black_s: float = LUIDOLT_S) -> Protocol:
    """Luidolt 2020, 5.2.1 ii and 6: a black screen, then a white one; the mean over all of each.

    Raises CalibrationError.
    """
    _refuse_unless_in_range("luidolt", (white_s, black_s), SECONDS_RANGE[0])
    steps = (Step(Screen.BLACK, black_s, black_s), Step(Screen.WHITE, white_s, white_s))
    return Protocol("luidolt", steps, Statistic.MEAN, must_settle=False)


def _refuse_unless_in_range(name: str, seconds: tuple[float, ...], least: float) -> None:
    for one in seconds:
        if not least <= one <= SECONDS_RANGE[1]:
            raise CalibrationError(
                f"protocol {name}: a screen of {one:g} s; choose from {least:g} to {SECONDS_RANGE[1]:g} s"
            )


class Stage(enum.StrEnum):
    """Where the routine is; see the table above."""

    READY = "ready"
    WAITING = "waiting for the display"
    SHOWING = "showing"
    PAUSED = "paused"
    ENDING = "ending"
    FINISHED = "finished"
    NOT_SHOWN = "not shown"
    ABORTED = "aborted"

    @property
    def is_final(self) -> bool:
        """Whether nothing more is going to happen."""
        return self in (Stage.FINISHED, Stage.NOT_SHOWN, Stage.ABORTED)


class ShowScreen(msgspec.Struct, frozen=True):
    """Asks a display for a screen."""

    screen: Screen
    id: int
    """Rises by one a screen; the display's answer names it."""
    step: int
    """Which step of the protocol, from 1; 0 for grey."""
    steps: int
    seconds: float | None
    """For how long it is going to stay; None for grey, which stays until the next screen."""
    stage: Stage
    """Why: what the routine now waits for."""


class ShownScreen(msgspec.Struct, frozen=True):
    """A screen that was shown to its end."""

    screen: Screen
    t_ns: int
    """When it was really shown."""
    seconds: float
    use_last_s: float

    @property
    def window_ns(self) -> tuple[int, int]:
        """From when to when it is measured."""
        end_ns = self.t_ns + round(self.seconds * NS_PER_S)
        return end_ns - round(self.use_last_s * NS_PER_S), end_ns


Commands = tuple[ShowScreen, ...]


class Calibration:
    """One run of a protocol. Times are of the bridge's clock and never go backwards."""

    def __init__(self, protocol: Protocol, ids: Iterator[int] | None = None) -> None:
        """`ids` numbers the screens; runs before the same display share it."""
        self.protocol = protocol
        self.stage = Stage.READY
        self.samples: list[PupilSample] = []
        """All since the start, as they came, but for those of a pause longer than the newest `PAUSED_SAMPLES`."""
        self._paused: collections.deque[PupilSample] = collections.deque(maxlen=PAUSED_SAMPLES)
        self.shown_screens: list[ShownScreen] = []
        """Those shown to their end, one a step that is over."""
        self._ids = ids or itertools.count(1)
        self._asked: ShowScreen | None = None
        self._since_ns = 0
        """When the present screen was asked for while it is waited for; then when it was shown."""

    @property
    def step(self) -> Step:
        """The present step, or the last one."""
        return self.protocol.steps[min(len(self.shown_screens), len(self.protocol.steps) - 1)]

    def seconds_done(self, t_ns: int) -> float:
        """How much of the protocol is over."""
        done = sum(screen.seconds for screen in self.shown_screens)
        if self.stage is Stage.SHOWING:
            done += min((t_ns - self._since_ns) / NS_PER_S, self.step.seconds)
        return done

    def start(self, t_ns: int) -> Commands:
        """Asks for the first screen."""
        return self._ask(t_ns) if self.stage is Stage.READY else ()

    def sample(self, sample: PupilSample) -> None:
        """A sample has arrived."""
        if self.stage is Stage.PAUSED:
            self._paused.append(sample)
        elif self.stage is not Stage.READY and not self.stage.is_final:
            self.samples.append(sample)

    def shown(self, screen_id: int, shown_ns: int, t_ns: int) -> None:
        """The display says at `t_ns` that it has shown a screen at `shown_ns`.

        A screen cannot have been shown before it was asked for or later than now: such a time is a display's clock
        that is known badly, and the nearest possible one is taken.
        """
        if self.stage is Stage.WAITING and self._asked is not None and screen_id == self._asked.id:
            self.stage = Stage.SHOWING
            self._since_ns = min(max(shown_ns, self._since_ns), t_ns)

    def advance(self, t_ns: int) -> Commands:
        """Time has passed. To be called every 100 ms or more often."""
        if self.stage is Stage.WAITING and t_ns - self._since_ns > SHOWN_WITHIN_NS:
            return self._rest(Stage.NOT_SHOWN)
        end_ns = self._since_ns + round(self.step.seconds * NS_PER_S)
        if self.stage is Stage.SHOWING and t_ns >= end_ns:
            step = self.step
            self.shown_screens.append(ShownScreen(step.screen, self._since_ns, step.seconds, step.use_last_s))
            if len(self.shown_screens) < len(self.protocol.steps):
                return self._ask(t_ns)
            return self._rest(Stage.ENDING)
        if self.stage is Stage.ENDING and t_ns >= end_ns + LATE_SAMPLES_NS:
            self.stage = Stage.FINISHED
        return ()

    def pause(self) -> Commands:
        """Throws the present step away and waits for `resume`."""
        return self._rest(Stage.PAUSED) if self.stage in (Stage.WAITING, Stage.SHOWING) else ()

    def resume(self, t_ns: int) -> Commands:
        """Shows the step that was paused from its beginning."""
        if self.stage is not Stage.PAUSED:
            return ()
        self.samples += self._paused
        self._paused.clear()
        return self._ask(t_ns)

    def abort(self) -> Commands:
        """Ends without a result."""
        return () if self.stage.is_final else self._rest(Stage.ABORTED)

    def _ask(self, t_ns: int) -> Commands:
        self.stage, self._since_ns = Stage.WAITING, t_ns
        number = len(self.shown_screens) + 1
        self._asked = ShowScreen(
            self.step.screen, next(self._ids), number, len(self.protocol.steps), self.step.seconds, self.stage
        )
        return (self._asked,)

    def _rest(self, stage: Stage) -> Commands:
        self.stage = stage
        return (ShowScreen(Screen.GREY, next(self._ids), 0, len(self.protocol.steps), None, stage),)
