"""What comes of a run of the black and white screens: its judgement, its figures, its words, its files."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, cast

import msgspec

from entoptic.atomic_file import atomic_file, output_errors
from entoptic.services.calibration.run import Recorded
from entoptic.tracker_bridge import pupil_map
from entoptic.tracker_bridge.calibration import Screen, ShownScreen
from entoptic.tracker_bridge.calibration_quality import Analysis, EyeResult, Problem, analyse
from entoptic.tracker_bridge.pupil_map import LUI_MM, EyeMap, MappedWindow, PupilMap, PupilMapError, Use
from entoptic.tracker_bridge.samples import NS_PER_S, Eye


@dataclasses.dataclass(frozen=True)
class Attempt:
    """A run and what is to be thought of it."""

    recorded: Recorded
    analysis: Analysis

    @property
    def problems(self) -> tuple[Problem, ...]:
        """What is wrong with it; empty for a valid one."""
        return self.analysis.problems

    @property
    def screens(self) -> tuple[ShownScreen, ...]:
        """Those shown to their end."""
        return self.recorded.screens

    @property
    def words(self) -> str:
        """For the person before the display."""
        if not self.problems:
            return "Done, thank you: both the black and the white screens could be measured."
        first = self.problems[0]
        return f"No result: {first.failure.value}. To do: {first.remedy}."


class EyeFigures(msgspec.Struct, frozen=True):
    """One eye's result; None where there is none."""

    white: float | None
    black: float | None
    span: float | None
    unit: str
    """Of these three: mm or px."""
    tracked_share: float | None
    """The least of all windows'."""
    slope_mm_s: float | None
    """The steepest of all windows', without its sign."""
    stretch: float | None


def judge(recorded: Recorded) -> Attempt:
    """Takes a quarter of a second for a whole run at 200 Hz."""
    one = recorded
    return Attempt(one, analyse(one.samples, one.screens, one.protocol, one.stage, one.eyes))


def figures(result: EyeResult) -> EyeFigures:
    """An eye's result in the tracker's own unit."""
    shown = {window.screen for window in result.windows}
    white, black = (result.of(one) if one in shown else math.nan for one in (Screen.WHITE, Screen.BLACK))
    return EyeFigures(
        white=_finite(white),
        black=_finite(black),
        span=_finite(black - white),
        unit=result.trace.unit,
        tracked_share=min((window.valid_share for window in result.windows), default=None),
        slope_mm_s=_finite(max((abs(window.slope_mm_s) for window in result.windows), default=math.nan)),
        stretch=_finite(_stretch(result)) if black > white else None,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _stretch(result: EyeResult) -> float:
    return (LUI_MM[1] - LUI_MM[0]) / result.span_mm


def pupil_map_of(attempt: Attempt, source: str, display: str, uncertainty_ns: int | None, *, map_mm: bool) -> PupilMap:
    """What a valid attempt leaves. Pixels are always mapped onto 2 to 8 mm, a tracker's millimetres if `map_mm`.

    Raises PupilMapError where the eyes' units differ.
    """
    eyes = attempt.analysis.eyes
    units = {result.trace.unit for result in eyes.values()}
    if len(units) > 1:
        raise PupilMapError("one eye comes in mm and the other in px: choose one of them with --eyes")
    unit = units.pop()
    start_ns = attempt.screens[0].t_ns
    return PupilMap(
        format=1,
        program=f"entoptic {importlib.metadata.version('entoptic')}",
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        source=source,
        display=display,
        protocol=attempt.recorded.protocol.name,
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
        white=result.of(Screen.WHITE), black=result.of(Screen.BLACK), stretch=_stretch(result), windows=windows
    )


def refuse_unwritable(out: Path) -> None:
    """Raises PupilMapError where the result could not be written, before anybody looks at a screen."""
    if out.suffix != ".toml":
        raise PupilMapError(f"--out {out}: a pupil map is a TOML file; name it like my_pupil.toml")
    if out.is_dir() or not out.parent.is_dir():
        reason = "is a folder" if out.is_dir() else f"lies in {out.parent}, which is no folder"
        raise PupilMapError(f"--out {out} {reason}; name a file in a folder that is there")


def write(out: Path, found: PupilMap, attempt: Attempt) -> Path:
    """Writes the map and its plot beside it, both or none; returns the plot's path. Raises OutputError."""
    plot = out.with_suffix(".png")
    with output_errors(out), atomic_file(out) as partial:
        partial.write_text(pupil_map.text(found), encoding="utf-8")
        write_plot(plot, attempt, f"{found.source}, {found.date}, protocol {found.protocol}")
    return plot


def write_failed_plot(out: Path, attempt: Attempt, source: str) -> Path:
    """Writes the plot of a run without a result beside where that would lie; its path. Raises OutputError."""
    plot = out.with_suffix(".failed.png")
    write_plot(plot, attempt, f"{source}, protocol {attempt.recorded.protocol.name}: no result")
    return plot


def write_plot(path: Path, attempt: Attempt, title: str) -> None:
    """Writes the picture of an attempt. Raises OutputError."""
    from entoptic.services.calibration import (
        plot as calibration_plot,  # with Matplotlib, which takes a second to import
    )

    with output_errors(path), atomic_file(path) as partial:
        calibration_plot.write(partial, attempt.analysis, attempt.screens, title)
