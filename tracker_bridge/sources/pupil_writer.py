"""Writes samples as a recording folder of Pupil Core, which recording.py reads back.

What comes back is the same but for this:
- Times are seconds in 64-bit floats: exact to the nanosecond up to 11 days of clock, to 1 µs for 100 years and more.
- Directions come back within 1e-9°; they must lie less than 90° from straight ahead, as a scene camera's do.
- A sample without px gets px of its mm, at the scale of a simulated camera.
- Pupil Core knows no openness; it is written under a key of its own, which other programs skip.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.source import RecordedSource, SourceError
from entoptic.tracker_bridge.sources.loaded import sort_key
from entoptic.tracker_bridge.sources.pupil_form import is_writable
from entoptic.tracker_bridge.sources.pupil_recorder import PupilRecorder


def write_recording(source: RecordedSource, folder: Path) -> None:
    """Writes all samples of a source, which must end, as a new recording folder of Pupil Core.

    In it are pupil.pldata, gaze.pldata, the timestamps of both and info.player.json; see pupil_form.py for what
    becomes of which sample. The folder appears whole or not at all.

    Raises SourceError where the folder exists, there are no samples, or a direction lies 90° or more to a side.
    """
    ordered = sorted(source.samples(), key=sort_key)
    if not ordered:
        raise SourceError(f"{folder}: there are no samples to write")
    if folder.exists():
        raise SourceError(f"{folder} exists already: choose another name, or remove it first")
    for sample in ordered:
        if not is_writable(sample):
            raise SourceError(
                f"a direction cannot be written: a scene camera sees less than 90° to each side; {sample}"
            )
    # Nobody knows what time of day it was: both clocks start together.
    start_s = ordered[0].t_ns / NS_PER_S
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as scratch:
            whole = Path(scratch) / folder.name
            with PupilRecorder(whole, start_synced_s=start_s, start_system_s=start_s) as recorder:
                for sample in ordered:
                    recorder.add(sample)
            whole.rename(folder)
    except OSError as error:
        raise SourceError(f"{folder} cannot be written: {error.strerror}. Choose another place") from None
