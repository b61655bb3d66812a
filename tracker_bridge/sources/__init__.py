"""Where samples come from. Each source says in its `info.notes` what it had to repair or assume.

recording.py      recordings of Pupil Capture and Pupil Service
player_export.py  tables that Pupil Player exports
table.py          any other table, by a column map
table_map.py      column maps: their keys, their files; those that come with the program lie in maps/
simulated.py      a simulated pair of eyes, labelled

pupil_datum.py    one pupil or gaze datum of Pupil Core, from bytes to samples
pupil_streams.py  a whole session of such datums, as a source
pupil_writer.py   the other way: samples as a recording of Pupil Core
cells.py          text tables, with errors that name line and column
loaded.py         samples in order of time, each time and eye once
simulated_*.py    the simulation's parts: gaze, lids, pupil, tracker, truth
"""

from __future__ import annotations

from pathlib import Path

from tracker_bridge.samples import Source, SourceError
from tracker_bridge.sources import player_export, recording
from tracker_bridge.sources.cells import read_header
from tracker_bridge.sources.player_export import is_player_export, open_player_export
from tracker_bridge.sources.recording import open_recording
from tracker_bridge.sources.simulated import SimulatedEyes, SimulatedSettings
from tracker_bridge.sources.table import open_table
from tracker_bridge.sources.table_map import read_table_map

SIMULATED = "simulated"


def open_source(spec: str, *, table_map: Path | None = None, simulated: SimulatedSettings | None = None) -> Source:
    """The source that `spec` names.

    "simulated" is a simulated pair of eyes, with the settings given. Anything else is a path: to a folder recorded by
    Pupil Capture or one of its .pldata files, to a folder of Pupil Player's exports or one of its tables, or to any
    other .csv, .tsv or .txt table. A table is read by `table_map`, or else by the first map that comes with the
    program and fits.

    Raises SourceError that names the thing and the remedy, also where a setting is out of range or an option does not
    go with the source.
    """
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


def _holds(folder: Path, *names: str) -> bool:
    return any((folder / name).is_file() for name in names)
