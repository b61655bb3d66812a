"""What came of a run of the black and white screens: judged, written and drawn, for command and live bridge alike.

A command does it at once (`Concluded`). A bridge has it done by a process of its own (`Concluding`): judging and
drawing take a second of computing, and in a thread of the bridge's they held its samples up by 45 ms. The run goes to
the process's standard input and the outcome comes from its standard output, each one msgpack map.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from pathlib import Path

import msgspec

from entoptic.errors import OutputError
from entoptic.services.calibration.result import EyeFigures, figures, judge, pupil_map_of, write, write_failed_plot
from entoptic.services.calibration.run import Recorded
from entoptic.tracker_bridge.pupil_map import PupilMap, PupilMapError

_UNFINISHED = "not worked out"
_WITHIN_S = 60.0
"""Engineering choice: thirty times what it takes."""


class Job(msgspec.Struct, frozen=True):
    """A run, and where its result is to lie."""

    recorded: Recorded
    out: str
    source: str
    display: str
    uncertainty_ns: int | None
    map_mm: bool
    plot_failed: bool
    """Whether a run without a result leaves its plot."""


class Named(msgspec.Struct, frozen=True):
    """One thing that is wrong."""

    name: str
    detail: str
    remedy: str


class Outcome(msgspec.Struct, frozen=True):
    """What came of it."""

    found: PupilMap | None
    """None unless it is valid and written."""
    plot: str | None
    eyes: dict[str, EyeFigures]
    """By name: left, right."""
    problems: tuple[Named, ...]
    words: str
    """For the person before the display."""

    @classmethod
    def without_result(cls, problem: Named) -> Outcome:
        """Nothing was judged."""
        return cls(None, None, {}, (problem,), f"No result: {problem.detail}. To do: {problem.remedy}.")


def conclude(job: Job) -> Outcome:
    """Judges a run and writes its map and plot, or the plot of a failed one."""
    attempt, out = judge(job.recorded), Path(job.out)
    eyes = {eye.name.lower(): figures(result) for eye, result in attempt.analysis.eyes.items()}
    problems = tuple(Named(one.name, one.detail, one.remedy) for one in attempt.problems)
    words, found, plot = attempt.words, None, None
    try:
        if problems and job.plot_failed:
            plot = write_failed_plot(out, attempt, job.source)
        elif not problems:
            found = pupil_map_of(attempt, job.source, job.display, job.uncertainty_ns, map_mm=job.map_mm)
            plot = write(out, found, attempt)
    except (PupilMapError, OutputError) as error:
        detail, _, remedy = str(error).partition("; ")
        problem = Named("not written", detail, remedy or "calibrate again")
        return Outcome(None, None, eyes, (*problems, problem), words if problems else f"No result: {error}.")
    return Outcome(found, None if plot is None else str(plot), eyes, problems, words)


class Concluded:
    """A run that was worked out at once: where nothing else waits."""

    def __init__(self, job: Job) -> None:
        self.outcome: Outcome | None = conclude(job)

    def end(self) -> None:
        """There is nothing to give up."""


class Concluding:
    """A run that is being worked out by another process; ask for its `outcome` now and then."""

    def __init__(self, job: Job) -> None:
        self._ended = False
        self._outcome: Outcome | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._work, args=(job,), name="pupil-outcome", daemon=True)
        self._thread.start()

    @property
    def outcome(self) -> Outcome | None:
        """None as long as it is not known."""
        return self._outcome

    def end(self) -> None:
        """Gives up what is not worked out yet."""
        with self._lock:
            self._ended = True
            if self._process is not None and self._process.poll() is None:
                self._process.kill()
        self._thread.join()

    def _work(self, job: Job) -> None:
        request, reply, errors = msgspec.msgpack.encode(job), b"", b""
        try:
            with self._lock:
                if self._ended:
                    return
                # -P: no module of the folder that the bridge happens to run in.
                command = [sys.executable, "-P", "-m", "entoptic.services.calibration.outcome"]
                pipe = subprocess.PIPE
                self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe)
            try:
                reply, errors = self._process.communicate(request, timeout=_WITHIN_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.communicate()
                detail = f"it took longer than {_WITHIN_S:.0f} s"
                self._outcome = Outcome.without_result(
                    Named(_UNFINISHED, detail, "see what else runs, and calibrate again")
                )
                return
            self._outcome = msgspec.msgpack.decode(reply, type=Outcome)
        except (OSError, msgspec.DecodeError) as error:
            lines = errors.decode(errors="replace").strip().splitlines()
            detail = f"the process that works it out failed: {lines[-1] if lines else error}"
            self._outcome = Outcome.without_result(Named(_UNFINISHED, detail, "calibrate again"))


def main() -> None:
    """The process."""
    job = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Job)
    sys.stdout.buffer.write(msgspec.msgpack.encode(conclude(job)))


if __name__ == "__main__":
    main()
