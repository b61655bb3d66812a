"""A whole session: bridge and worker as two processes, their progress, their failures, and what they leave.

Theory of operation: each process writes its log to standard error, a JSON object a line; this one reads both. A
process is asked to stop by closing its standard input, so it stops too if this one dies. All results are written into
a folder beside the final one, which takes its name only when they are whole.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from entoptic.errors import EntopticError
from entoptic.services.eye_data import SIMULATED_SECONDS
from entoptic.services.live.arguments import recorded_bridge_arguments, recorded_worker_arguments
from entoptic.services.live.checked import Checked
from entoptic.services.live.children import Child
from entoptic.services.process import STOPS_WITHIN_S, Stop
from entoptic.services.psf import observer_file
from entoptic.services.results import session_file
from entoptic.services.results.folder import results_folder
from entoptic.tracker_bridge.sources import SIMULATED

READY_WITHIN_S = 60.0
STOPPED_WITHIN_S = 1.0
"""Where nothing is lost by ending a process by force."""
NOTHING = "stopped before the first frame: nothing was written"


class SessionError(EntopticError):
    """A session failed: the message names the process and what it said."""


class StoppedError(SessionError):
    """A person stopped a session before there was anything to be kept."""


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a session."""

    bridge: dict[str, Any]
    """What the bridge said when it ended."""
    worker: dict[str, Any]
    """What the worker said when it ended."""
    interrupted: bool
    trouble: str | None = None
    """Of a process that failed when it was asked to stop."""


def _failed(child: Child, said: str | None) -> SessionError:
    return SessionError(f"the {child.name} failed {child.ending(said)}")


def keep(checked: Checked, final: Path, stop: Stop, console: Console) -> Outcome:
    """Renders every frame of a recording into a folder with all that belongs to it.

    Raises SessionError, StoppedError and ResultsFolderError; then no folder is left.
    """
    from entoptic.atomic_file import write_json
    from entoptic.services import simulated_light
    from entoptic.services.live import takes
    from entoptic.services.report import page as report
    from entoptic.services.results.finish import finish
    from entoptic.services.results.folder import BRIDGE

    with results_folder(final) as folder:
        observer_file.write(folder / "settings.toml", checked.settings)
        takes.of_session(checked, "offline").write(folder)
        if (trouble := takes.keep_inputs(folder, checked)) is not None:
            console.print(f"[yellow]![/yellow] {escape(trouble)}", soft_wrap=True)
        light = folder / "scene_luminance.csv"
        if checked.choice.source == SIMULATED:
            seconds = checked.choice.seconds or SIMULATED_SECONDS
            steps = simulated_light.of_scene(checked.scene, checked.view, checked.choice.head, seconds)
            simulated_light.write(light, steps)
        bridge = recorded_bridge_arguments(checked.choice, folder, light if light.exists() else None)
        worker = recorded_worker_arguments(checked.choice, folder, folder / "settings.toml")
        outcome = run(bridge, worker, stop, console)
        notes = takes.HostNotes(interrupted=outcome.interrupted, trouble=outcome.trouble)
        write_json(folder / BRIDGE, outcome.bridge)
        write_json(folder / takes.SUMMARY, takes.told(session_file.read(folder), notes, finish(folder)))
        report.write(folder)
    return outcome


def run(bridge_arguments: Sequence[str], worker_arguments: Sequence[str], stop: Stop, console: Console) -> Outcome:
    """Runs both processes to their end, or until asked to stop; leaves no process behind.

    Raises SessionError, and StoppedError where that was before the first frame.
    """
    with contextlib.ExitStack() as children:
        bridge = Child("bridge", bridge_arguments)
        children.callback(end, bridge, stop)
        ready = _wait_for_ready(bridge, stop)
        if ready is None:
            raise StoppedError(NOTHING)
        addresses = ["--states", ready["states"], "--events", ready["events"]]
        worker = Child("worker", [*worker_arguments, *addresses])
        children.callback(end, worker, stop)
        return _watch(bridge, worker, stop, console)


def end(child: Child, stop: Stop) -> None:
    """Leaves it no time to finish what nobody will keep, as a compilation, if a person stopped all."""
    child.end(STOPPED_WITHIN_S if stop() else STOPS_WITHIN_S)


def _wait_for_ready(bridge: Child, stop: Stop) -> dict[str, Any] | None:
    deadline, said = time.monotonic() + READY_WITHIN_S, None
    while not stop():
        ended = bridge.code() is not None
        for message in bridge.drain():
            if message["event"] == "ready":
                return message
            said = message.get("error", said)
        if ended or time.monotonic() > deadline:
            raise _failed(bridge, said)
        time.sleep(0.02)
    return None


def _watch(bridge: Child, worker: Child, stop: Stop, console: Console) -> Outcome:
    endings: dict[str, dict[str, Any]] = {"bridge": {}, "worker": {}}
    said: dict[str, str | None] = {"bridge": None, "worker": None}
    interrupted = prepared = False
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
    ) as progress:
        task = progress.add_task("starting", total=None)
        while True:
            if stop() and not prepared:
                raise StoppedError(NOTHING)
            if stop() and not interrupted:
                interrupted = True
                progress.update(task, description="stopping")
                for child in (worker, bridge):
                    child.ask_to_stop()
            # Asked first and read after, so that nothing said before the end is missed.
            codes = {child.name: child.code() for child in (bridge, worker)}
            for child in (bridge, worker):
                for message in child.drain():
                    said[child.name] = message.get("error", said[child.name])
                    match message["event"]:
                        case "ended":
                            endings[child.name] = message
                        case "preparing":
                            progress.update(task, description="compiling")
                        case "prepared":
                            prepared = True
                        case "progress":
                            _show(progress, task, message)
            failed = [_failed(child, said[child.name]) for child in (bridge, worker) if codes[child.name]]
            if failed and not interrupted:
                raise failed[0]
            if codes["worker"] is not None:
                # An early end of the frames leaves the bridge with states nobody wants.
                bridge.ask_to_stop()
                if codes["bridge"] is not None:
                    trouble = "; ".join(str(one) for one in failed) or None
                    return Outcome(endings["bridge"], endings["worker"], interrupted, trouble)
            time.sleep(0.02)


def _show(progress: Progress, task: Any, message: dict[str, Any]) -> None:
    dropped = message["dropped"]
    progress.update(
        task,
        description="rendering" + (f", {dropped} frames dropped" if dropped else ""),
        completed=message["frame"],
        total=message["frames"],
    )
