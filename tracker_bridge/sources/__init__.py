"""Where samples come from. Each source says in its `info.notes` what it had to repair or assume.

pupil_core/  Pupil Capture and Service, live; their recordings and Pupil Player's tables
usb/, hid/   USB (HID) eye trackers, live, and what one once sent
table/       any other table, by a column map
simulated/   a simulated pair of eyes, labelled: whole, or live

cells.py     text tables, with errors that name line and column
loaded.py    samples in order of time, each time and eye once
played.py    any recording as a live source
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import msgspec

from entoptic.tracker_bridge.source import Source, SourceError
from entoptic.tracker_bridge.sources.cells import read_header
from entoptic.tracker_bridge.sources.pupil_core import player_export, recording
from entoptic.tracker_bridge.sources.pupil_core.player_export import is_player_export, open_player_export
from entoptic.tracker_bridge.sources.pupil_core.recording import open_recording
from entoptic.tracker_bridge.sources.pupil_core.remote import DEFAULT_REMOTE
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedEyes, SimulatedSettings
from entoptic.tracker_bridge.sources.table.map import read_table_map
from entoptic.tracker_bridge.sources.table.source import open_table

SIMULATED, CAPTURE = "simulated", "capture"
USB, USB_SIMULATED, USB_FILE = "usb", "usb-simulated:", "usb-file:"
SPECS: Final = (
    "Eye data: simulated, a folder recorded by Pupil Capture, an export of Pupil Player, any .csv/.tsv table "
    "(see --map), or usb-file:PATH; live also capture, usb and usb-simulated:RECORDING."
)
"""What `open_source` opens, for the command line's help."""


class TrackerSettings(msgspec.Struct, frozen=True, kw_only=True):
    """How live trackers are reached."""

    remote: str = DEFAULT_REMOTE
    """Where Pupil Remote listens."""
    usb_id: str | None = None
    """VID:PID of the USB tracker; the first one unless given."""
    usb_faults: tuple[str, ...] = ()
    """What goes wrong with a simulated USB tracker; see usb_twin/faults.py."""
    usb_begun_ns: int | None = None
    """When a simulated USB tracker was plugged in, on the monotonic clock, if it was before."""
    record_raw: Path | None = None
    """A new file for all that a USB tracker sends."""


def open_source(
    spec: str,
    *,
    table_map: Path | None = None,
    simulated: SimulatedSettings | None = None,
    tracker: TrackerSettings | None = None,
) -> Source:
    """The source that `spec` names.

    "capture" is Pupil Capture and "usb" a USB eye tracker, both live; "usb-simulated:SPEC" plays any recording as such
    a tracker, and "usb-file:PATH" what one once sent. "simulated" is a simulated pair of eyes, with the settings given.
    Anything else is a path: to a folder recorded by Pupil Capture or one of its .pldata files, to a folder of Pupil
    Player's exports or one of its tables, or to any other .csv, .tsv or .txt table. A table is read by `table_map`, or
    else by the first map that comes with the program and fits.

    Raises SourceError that names the thing and the remedy, also where a setting is out of range or an option does not
    go with the source.
    """
    live = _open_tracker(spec, table_map, simulated, tracker or TrackerSettings())
    if live is not None:
        return live
    if spec == SIMULATED:
        if table_map is not None:
            raise SourceError("a simulated eye takes no column map: leave the map out, or name a table")
        return SimulatedEyes(simulated or SimulatedSettings())
    path = Path(spec)
    if path.is_dir():
        if _holds(path, recording.PUPIL_FILE, recording.GAZE_FILE):
            return open_recording(path)
        if _holds(path, player_export.PUPIL_FILE, player_export.GAZE_FILE):
            return open_player_export(path)
        raise SourceError(
            f"{path} is neither a recording ({recording.PUPIL_FILE}, {recording.GAZE_FILE}) nor an export of Pupil "
            f"Player ({player_export.PUPIL_FILE}, {player_export.GAZE_FILE}): name such a folder, or a table in it"
        )
    if not path.exists():
        raise SourceError(f"{spec} does not exist: name a recording's folder, a table, or `{SIMULATED}`")
    if path.suffix == ".pldata":
        return open_recording(path)
    if path.suffix in (".csv", ".tsv", ".txt"):
        if table_map is not None:
            return open_table(path, read_table_map(table_map))
        if is_player_export(read_header(path, ",")):
            return open_player_export(path)
        return open_table(path)
    raise SourceError(f"{path} is of no kind that can be read: name a folder, a .pldata file, or a .csv or .tsv table")


def _open_tracker(
    spec: str, table_map: Path | None, simulated: SimulatedSettings | None, tracker: TrackerSettings
) -> Source | None:
    """A tracker, or what one sent; None where `spec` names neither."""
    is_usb = spec == USB or spec.startswith(USB_SIMULATED)
    if tracker.record_raw is not None and not is_usb:
        raise SourceError(f"{spec} sends no USB packets that could be recorded: leave --record-raw out")
    if tracker.usb_id is not None and spec != USB:
        raise SourceError(f"{spec} is not looked for by VID:PID: leave --usb-id out, or name `{USB}`")
    if tracker.usb_faults and not spec.startswith(USB_SIMULATED):
        raise SourceError(f"only a simulated tracker has faults: name {USB_SIMULATED}RECORDING, or leave them out")
    if table_map is not None and (spec in (CAPTURE, USB) or spec.startswith(USB_FILE)):
        raise SourceError(f"{spec} takes no column map: leave the map out, or name a table")
    if spec == CAPTURE:
        from entoptic.tracker_bridge.sources.pupil_core.capture import PupilCapture

        return PupilCapture(tracker.remote)
    if spec == USB:
        from entoptic.tracker_bridge.sources.usb.tracker import UsbTracker

        return UsbTracker(tracker.usb_id, capture=tracker.record_raw)
    if spec.startswith(USB_SIMULATED):
        from entoptic.tracker_bridge.usb_twin.backend import open_usb_simulated

        played = open_source(spec.removeprefix(USB_SIMULATED), table_map=table_map, simulated=simulated)
        return open_usb_simulated(played, tracker.usb_faults, capture=tracker.record_raw, begun_ns=tracker.usb_begun_ns)
    if spec.startswith(USB_FILE):
        from entoptic.tracker_bridge.sources.usb.capture import open_usb_file

        return open_usb_file(Path(spec.removeprefix(USB_FILE)))
    return None


def _holds(folder: Path, *names: str) -> bool:
    return any((folder / name).is_file() for name in names)
