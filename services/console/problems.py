"""What is wrong, in words, and what to do: what the processes say themselves, and what only the console sees."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from entoptic.services.ipc.status import BridgeStatus, HostStatus, Problem, WorkerStatus, merged, problem

LOST_S = 1.5
"""Longer than any blink. Engineering choice."""
NO_STATES_S = 2.0
NO_FRAMES_S = 4.0
"""Engineering choice: longer than a frame of everything at a large size takes."""
CLOCK_MS = 20.0
"""Half a frame at 24 a second: from here on frames show a gaze that is visibly late or early."""
BEHIND_SHARE = 0.1
"""Of frames left out: from here on motion is seen to stutter. Engineering choice."""
LATE_MS = 250.0
"""A blink lasts that long: what is shown belongs to another moment. Engineering choice."""
SCENE_SHARE = 0.5
"""Of a frame's work: beyond it no budget for effects helps as much as another scene."""
LITTLE_BYTES, VERY_LITTLE_BYTES = 2_000_000_000, 200_000_000
"""An hour's recording and a minute's, roughly."""


class Snapshot(msgspec.Struct, frozen=True, kw_only=True):
    """All that is known at a moment. Of a process that does not answer nothing is known: None."""

    hosted: bool
    host: HostStatus | None = None
    bridge: BridgeStatus | None = None
    worker: WorkerStatus | None = None
    silent_s: dict[str, float] = {}
    """Of host, bridge and worker those that do not answer, and for how long."""
    lost_s: dict[str, float] = {}
    """For how long each lost eye has been lost."""
    states_silent_s: float | None = None
    """Since the last state came; None if none ever came."""
    frames_silent_s: float | None = None
    """The same of frames."""
    dropped_share: float = 0.0
    """Of the frames due in the last ten seconds."""
    unreachable: str | None = None
    """Why an address cannot be connected to."""
    latency_p95_ms: float | None = None
    free_bytes: int | None = None
    """On the disk where recordings go; None where that is not known."""


def problems(now: Snapshot) -> tuple[Problem, ...]:
    """All that is wrong, the worst first, each once."""
    reported = [status.problems for status in (now.host, now.bridge, now.worker) if status is not None]
    codes = {one.code for each in reported for one in each}
    found = [*_of_answers(now)]
    if "disk full" not in codes:
        found += _of_disk(now)
    if now.host.running if now.host is not None else not now.hosted:
        found += [] if "no tracker" in codes else _of_eyes(now)
        found += _of_frames(now)
    return merged(*reported, found)


def _of_answers(now: Snapshot) -> Iterator[Problem]:
    if now.unreachable is not None:
        yield problem("unreachable", "error", now.unreachable, "Give the addresses that bridge and worker log")
    for name, silent_s in now.silent_s.items():
        if name == "host":
            yield problem(
                "host gone",
                "error",
                f"The program that runs the session has not answered for {silent_s:.0f} s",
                "Look at the terminal where it was started, and start it again; what was recorded is kept",
            )
        else:
            yield problem(
                f"{name} silent",
                "error",
                f"The {name} has not answered for {silent_s:.0f} s",
                f"See that the {name} runs, and that the console was given the addresses that it logs",
            )
    if now.host is not None and not now.host.running:
        yield problem("nothing runs", "note", "No session runs", "Choose eyes and a scene, then Start")


def _of_disk(now: Snapshot) -> Iterator[Problem]:
    if now.free_bytes is not None and now.free_bytes < LITTLE_BYTES:
        yield problem(
            "disk nearly full",
            "error" if now.free_bytes < VERY_LITTLE_BYTES else "warning",
            f"Only {now.free_bytes / 1e6:.0f} MB are left on the disk where recordings go",
            "Delete or move old recordings, or start with another --root",
        )


def _of_eyes(now: Snapshot) -> Iterator[Problem]:
    if now.bridge is None:
        return
    if now.states_silent_s is not None and now.states_silent_s > NO_STATES_S:
        yield problem(
            "no states",
            "error",
            f"No eye states have come for {now.states_silent_s:.0f} s, though the bridge runs",
            "If a recording was played it may be over; otherwise stop and start again",
        )
        return
    lost = [eye for eye in ("left", "right") if now.lost_s.get(eye, 0.0) > LOST_S]
    for eye in lost:
        both = len(lost) == 2
        yield problem(
            f"pupil lost {eye}",
            "error" if both else "warning",
            f"The {eye} pupil has been lost for {now.lost_s[eye]:.0f} s"
            + (", and the other one too" if both else "; the other eye's is shown instead"),
            f"Look at the tracker's picture of the {eye} eye: eye open, camera on it, in focus, no reflection",
        )
    uncertainty_ms = now.bridge.clock_uncertainty_ms
    if uncertainty_ms is not None and uncertainty_ms > CLOCK_MS:
        yield problem(
            "clock uncertain",
            "warning",
            f"The tracker's clock is known to ±{uncertainty_ms:.0f} ms only",
            "Give it a minute. If it stays, use a cable instead of a wireless network, and load the machine less",
        )


def _of_frames(now: Snapshot) -> Iterator[Problem]:
    worker = now.worker
    if worker is None or worker.preparing:
        return
    scene = _of_scene(worker)
    remedy = "another scene" if scene else "a time budget under Plan"
    if now.frames_silent_s is not None and now.frames_silent_s > NO_FRAMES_S:
        yield problem(
            "no frames",
            "error",
            f"No frame has come from the worker for {now.frames_silent_s:.0f} s",
            "Stop the session and start it again with fewer pixels",
        )
    elif now.dropped_share > BEHIND_SHARE:
        reached = "" if worker.reached_fps is None else f": {worker.reached_fps:.1f} frames a second"
        asked = "" if worker.fps is None or not reached else f" of {worker.fps:g} asked for"
        yield problem(
            "worker behind",
            "warning",
            f"The worker leaves out {100 * now.dropped_share:.0f} % of the frames{reached}{asked}{scene}",
            f"Choose fewer pixels, fewer frames a second, or {remedy}",
        )
    elif now.latency_p95_ms is not None and now.latency_p95_ms > LATE_MS:
        yield problem(
            "late",
            "warning",
            f"From a sample to its light it takes up to {now.latency_p95_ms:.0f} ms (95 % of frames){scene}",
            f"Choose fewer pixels or {remedy}",
        )


def _of_scene(worker: WorkerStatus) -> str:
    """That it is the scene that is slow, if it is."""
    if worker.scene_ms is None or worker.frame_ms is None or worker.scene_ms <= SCENE_SHARE * worker.frame_ms:
        return ""
    return f"; making the scene takes {worker.scene_ms:.0f} of {worker.frame_ms:.0f} ms of a frame"
