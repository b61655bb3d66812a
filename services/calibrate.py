"""Runs the black and white screens before a person, or simulated eyes, and keeps the result."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.metadata
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, cast

import msgspec

from services import calibration_plot
from services.calibration_display import Display, Request, ScreenShown
from tracker_bridge import pupil_map
from tracker_bridge.calibration import Calibration, Commands, Protocol, Screen, ShownScreen, Stage
from tracker_bridge.calibration_quality import Analysis, EyeResult, Problem, analyse
from tracker_bridge.events import SourceSilent
from tracker_bridge.pupil_map import LUI_MM, EyeMap, MappedWindow, PupilMap, PupilMapError, Use
from tracker_bridge.samples import NS_PER_S, Eye, GazeSample, PupilSample
from tracker_bridge.source import Item, Source, SourceError, Tick
from tracker_bridge.sources.simulated import SimulatedSettings
from tracker_bridge.sources.simulated_live import SimulatedLiveEyes

GREY_SHARE = 0.2159
"""Luminance of sRGB's middle grey, #808080, of white's (IEC 61966-2-1)."""
LONGEST_S = 900.0
"""How long simulated eyes live: long enough for pauses and repetitions, and drawn in 2 s."""


@dataclasses.dataclass(frozen=True)
class Attempt:
    """One run of a protocol and what is to be thought of it."""

    analysis: Analysis
    screens: tuple[ShownScreen, ...]
    stage: Stage

    @property
    def problems(self) -> tuple[Problem, ...]:
        """What is wrong with it; empty for a valid one."""
        return self.analysis.problems


@dataclasses.dataclass(frozen=True)
class Room:
    """A display before simulated eyes: their light follows the screens. Without eyes, a display before a person."""

    display: Display
    eyes: SimulatedLiveEyes | None = None
    white_cd_m2: float = 200.0
    black_cd_m2: float = 0.05

    def light(self, screen: Screen, t_ns: int) -> None:
        """A screen was shown."""
        if self.eyes is not None:
            luminances = {Screen.WHITE: self.white_cd_m2, Screen.BLACK: self.black_cd_m2}
            self.eyes.set_luminance(luminances.get(screen, self.white_cd_m2 * GREY_SHARE), t_ns)


OnProgress = Callable[[Calibration, int], None]


class Runner:
    """Runs protocols, one after the other, on the samples of one source."""

    def __init__(
        self,
        source: Source,
        room: Room,
        stopped: Callable[[], bool],
        on_silence: Callable[[str], None] = lambda reason: None,
    ) -> None:
        """`on_silence` hears why, whenever the tracker falls silent."""
        self._on_silence = on_silence
        self._name = source.info.name
        self._room = room
        self._stopped = stopped
        # A simulation of a live source brings its own time; any other runs by this machine's.
        self._own_time = isinstance(source, SimulatedLiveEyes) and not source.info.live
        live = source.info.live or self._own_time
        self._items = source.samples() if live else _paced(source, stopped)

    def run(
        self, protocol: Protocol, eyes: Sequence[Eye] = tuple(Eye), on_progress: OnProgress = lambda _, __: None
    ) -> Attempt:
        """One attempt, from when the person starts it. Raises SourceError if the source ends before it does."""
        calibration = Calibration(protocol)
        asked: dict[int, Screen] = {}
        wants_start = False
        for item in self._items:
            if isinstance(item, GazeSample):
                continue
            if isinstance(item, SourceSilent):
                self._on_silence(item.reason)
            now_ns = item.t_ns if self._own_time else time.monotonic_ns()
            if self._stopped():
                self._show(calibration.abort(), asked)
            for answer in self._room.display.answers(now_ns):
                if isinstance(answer, ScreenShown):
                    calibration.shown(answer.id, answer.t_ns, now_ns)
                    if answer.id in asked:
                        self._room.light(asked.pop(answer.id), answer.t_ns)
                elif answer is Request.ABORT:
                    self._show(calibration.abort(), asked)
                elif answer is Request.PAUSE:
                    self._show(calibration.pause(), asked)
                    wants_start = False
                else:
                    wants_start = True
            if wants_start and self._room.display.ready:
                wants_start = False
                begin = calibration.resume if calibration.stage is Stage.PAUSED else calibration.start
                self._show(begin(now_ns), asked)
            if isinstance(item, PupilSample):
                calibration.sample(item)
            self._show(calibration.advance(now_ns), asked)
            if isinstance(item, Tick):
                on_progress(calibration, now_ns)
            if calibration.stage.is_final:
                break
        if not calibration.stage.is_final:
            if not self._stopped():
                raise SourceError(
                    f"{self._name} ended before the calibration did: choose a source that goes on, or one that lasts "
                    f"{protocol.seconds:g} s and more"
                )
            calibration.abort()
        screens = tuple(calibration.shown_screens)
        analysis = analyse(calibration.samples, screens, protocol, calibration.stage, eyes)
        return Attempt(analysis, screens, calibration.stage)

    def close(self) -> None:
        """Frees what the source holds."""
        if hasattr(self._items, "close"):
            self._items.close()

    def _show(self, commands: Commands, asked: dict[int, Screen]) -> None:
        for command in commands:
            asked[command.id] = command.screen
            self._room.display.show(command)


def _paced(source: Source, stopped: Callable[[], bool]) -> Iterator[Item]:
    """A recording's samples as if they were measured now: at their pace, on this machine's clock."""
    shift_ns = time.monotonic_ns() - source.info.t_start_ns
    for item in source.samples():
        due_ns = item.t_ns + shift_ns
        while not stopped() and (left_ns := due_ns - time.monotonic_ns()) > 0:
            time.sleep(min(left_ns, NS_PER_S // 20) / NS_PER_S)
            yield Tick(min(time.monotonic_ns(), due_ns))
        yield msgspec.structs.replace(item, t_ns=due_ns)


def pupil_map_of(attempt: Attempt, protocol: Protocol, source: str, display: Display, *, map_mm: bool) -> PupilMap:
    """What a valid attempt leaves. Pixels are always mapped onto 2 to 8 mm, a tracker's millimetres if `map_mm`."""
    eyes = attempt.analysis.eyes
    units = {result.trace.unit for result in eyes.values()}
    if len(units) > 1:
        raise PupilMapError("one eye comes in mm and the other in px: choose one of them with --eyes")
    unit = units.pop()
    start_ns = attempt.screens[0].t_ns
    uncertainty_ns = display.uncertainty_ns
    return PupilMap(
        format=1,
        program=f"entoptic {importlib.metadata.version('entoptic')}",
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        source=source,
        display=display.name,
        protocol=protocol.name,
        unit=unit,
        use=Use.MAP if map_mm or unit == "px" else Use.CHECK,
        display_uncertainty_ms=None if uncertainty_ns is None else uncertainty_ns * 1e-6,
        right=_eye_map(eyes.get(Eye.RIGHT), attempt.screens, start_ns),
        left=_eye_map(eyes.get(Eye.LEFT), attempt.screens, start_ns),
    )


def _eye_map(result: EyeResult | None, screens: Sequence[ShownScreen], start_ns: int) -> EyeMap | None:
    if result is None:
        return None
    windows = tuple(
        MappedWindow(
            screen=cast(Literal["white", "black"], window.screen.value),
            shown_s=(screen.t_ns - start_ns) / NS_PER_S,
            from_s=(window.from_ns - start_ns) / NS_PER_S,
            to_s=(window.to_ns - start_ns) / NS_PER_S,
            value=window.value,
            valid_share=window.valid_share,
            slope_mm_s=window.slope_mm_s,
        )
        for screen, window in zip(screens, result.windows, strict=True)
    )
    return EyeMap(
        white=result.of(Screen.WHITE),
        black=result.of(Screen.BLACK),
        stretch=(LUI_MM[1] - LUI_MM[0]) / result.span_mm,
        windows=windows,
    )


def refuse_unwritable(out: Path) -> None:
    """Raises PupilMapError where the result could not be written, before anybody looks at a screen."""
    if out.suffix != ".toml":
        raise PupilMapError(f"--out {out}: a pupil map is a TOML file; name it like my_pupil.toml")
    if out.is_dir() or not out.parent.is_dir():
        reason = "is a folder" if out.is_dir() else f"lies in {out.parent}, which is no folder"
        raise PupilMapError(f"--out {out} {reason}; name a file in a folder that is there")


def write(out: Path, found: PupilMap, attempt: Attempt) -> Path:
    """Writes the map and its plot beside it, both or none; returns the plot's path. Raises PupilMapError."""
    partial = _partial(out)
    try:
        partial.write_text(pupil_map.text(found), encoding="utf-8")
        write_plot(plot := out.with_suffix(".png"), attempt, f"{found.source}, {found.date}, protocol {found.protocol}")
        partial.replace(out)
    except OSError as error:
        raise _unwritten(out, partial, error) from None
    except PupilMapError:
        partial.unlink()
        raise
    return plot


def write_plot(path: Path, attempt: Attempt, title: str) -> None:
    """Writes the picture of an attempt. Raises PupilMapError."""
    partial = _partial(path)
    try:
        calibration_plot.write(partial, attempt.analysis, attempt.screens, title)
        partial.replace(path)
    except OSError as error:
        raise _unwritten(path, partial, error) from None


def _partial(path: Path) -> Path:
    return path.with_name(f"{path.stem}.partial{path.suffix}")


def _unwritten(path: Path, partial: Path, error: OSError) -> PupilMapError:
    with contextlib.suppress(OSError):
        partial.unlink()
    return PupilMapError(f"{path} cannot be written ({error.strerror}); check its folder and the space on the disk")


def simulated_eyes(seed: int, room_cd_m2: float, *, paced: bool, seconds: float = LONGEST_S) -> SimulatedLiveEyes:
    """Eyes that answer to the screens, at first in this light."""
    settings = SimulatedSettings(seconds=seconds, seed=seed, luminance=((0.0, room_cd_m2),))
    return SimulatedLiveEyes(settings, paced=paced)
