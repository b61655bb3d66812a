"""What is wrong, in words, and what to do: pure, from a snapshot."""

from __future__ import annotations

from collections.abc import Iterator

from entoptic.services.console.protocol import Problem
from entoptic.services.console.status import SILENT_S, HostSays, ProcessSays, Snapshot

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
LITTLE_BYTES, VERY_LITTLE_BYTES = 2_000_000_000, 200_000_000
"""An hour's take and a minute's, roughly."""
TAKEN_BACK = "settings were taken back"
"""Words of services/worker/live.py, after all that is wrong with its take."""
_RANK = {"error": 0, "warning": 1, "note": 2}


def problems(now: Snapshot) -> tuple[Problem, ...]:
    """All that is wrong, the worst first."""
    found = [*_of_host(now), *_of_processes(now), *_of_disk(now)]
    if now.running and (now.host is not None or not now.hosted):
        found += [*_of_eyes(now), *_of_frames(now)]
    return tuple(sorted(found, key=lambda problem: _RANK[problem.severity]))


def _of_host(now: Snapshot) -> Iterator[Problem]:
    if not now.hosted:
        return
    if now.host is None:
        if now.host_silent_s > SILENT_S:
            yield Problem(
                "host gone",
                "error",
                f"The program that runs the session has not answered for {now.host_silent_s:.0f} s.",
                "Look at the terminal where it was started, and start it again; takes are kept up to the last second.",
            )
        return
    if trouble := _not_said_below(now.host.trouble or "", now):
        yield Problem("host trouble", "warning", _sentence(trouble), "Mend what it says, then start again.")
    if not now.host.running:
        yield Problem("nothing runs", "note", "No session runs.", "Choose eyes and a scene, then Start.")


def _not_said_below(trouble: str, now: Snapshot) -> str:
    """The host joins all that it hears of; what its processes say is told of them."""
    known = {
        now.trouble,
        now.bridge.trouble if now.bridge else None,
        now.worker.trouble if now.worker else None,
    }
    crashed = tuple(f"the {name} crashed" for name in now.host.processes) if now.host else ()
    parts = trouble.split("; ")
    if any(part.startswith(crashed) for part in parts):
        return ""
    return "; ".join(part for part in parts if part not in known)


def _of_processes(now: Snapshot) -> Iterator[Problem]:
    if now.host is not None and now.host.running:
        for name, process in now.host.processes.items():
            if name in ("bridge", "worker"):
                yield from _of_process(name, process, now.host)
    if now.hosted and (now.host is None or not now.host.running):
        return
    for name, said, silent_s in (
        ("bridge", now.bridge, now.bridge_silent_s),
        ("worker", now.worker, now.worker_silent_s),
    ):
        known = now.host.processes.get(name) if now.host is not None else None
        if said is None and silent_s > SILENT_S and (known is None or known.state == "running"):
            yield Problem(
                f"{name} silent",
                "error",
                f"The {name} has not answered for {silent_s:.0f} s.",
                "Stop the session and start it again."
                if now.hosted
                else f"See that the {name} runs, and that the console was given the addresses that it logs.",
            )


def _of_process(name: str, process: ProcessSays, host: HostSays) -> Iterator[Problem]:
    why = f": {process.last_error}" if process.last_error else ""
    if process.state == "restarting":
        yield Problem(
            f"{name} restarting",
            "warning",
            _sentence(f"The {name} crashed and is being started again{why}"),
            "Wait a moment. If it happens again and again, stop the session and look at its log.",
        )
    elif process.state == "failed":
        yield Problem(
            f"{name} failed",
            "error",
            _sentence(f"The {name} failed and is not started again{why}"),
            "Stop the session, mend what it says, and start again.",
        )


def _of_disk(now: Snapshot) -> Iterator[Problem]:
    if now.free_bytes is not None and now.free_bytes < LITTLE_BYTES:
        severity = "error" if now.free_bytes < VERY_LITTLE_BYTES else "warning"
        yield Problem(
            "disk nearly full",
            "error" if severity == "error" else "warning",
            f"Only {now.free_bytes / 1e6:.0f} MB are left on the disk where takes are kept.",
            "Delete or move old takes, or start with another --root.",
        )
    for name, trouble in (
        ("bridge", now.bridge.trouble if now.bridge else None),
        ("worker", now.trouble or (now.worker.trouble if now.worker else None)),
    ):
        kept, taken_back, why = (trouble or "").partition(TAKEN_BACK)
        if taken_back:
            yield Problem(
                "settings taken back",
                "warning",
                _sentence(f"The last {taken_back}{why}"),
                "Those from before go on. Choose other values under Settings.",
            )
        if kept := kept.rstrip("; "):
            yield Problem(
                f"{name} trouble",
                "error",
                _sentence(f"The {name} says: {kept}"),
                "What was kept before is whole. Make room or mend it, then Record again.",
            )


def _of_eyes(now: Snapshot) -> Iterator[Problem]:
    if now.bridge is None:
        return
    if now.bridge.silent:
        yield Problem(
            "no tracker",
            "error",
            _sentence(f"Nothing comes from the tracker: {now.bridge.silent}"),
            "Check that it is plugged in and its program runs; the session goes on as soon as it is back.",
        )
        return
    if now.states_silent_s is not None and now.states_silent_s > NO_STATES_S:
        yield Problem(
            "no states",
            "error",
            f"No eye states have come for {now.states_silent_s:.0f} s, though the bridge runs.",
            "If a recording was played it may be over; otherwise stop and start again.",
        )
        return
    lost = [eye for eye in ("left", "right") if now.lost_s.get(eye, 0.0) > LOST_S]
    for eye in lost:
        both = len(lost) == 2
        yield Problem(
            f"pupil lost {eye}",
            "error" if both else "warning",
            f"The {eye} pupil has been lost for {now.lost_s[eye]:.0f} s"
            + (", and the other one too." if both else "; the other eye's is shown instead."),
            f"Look at the tracker's picture of the {eye} eye: eye open, camera on it, in focus, no reflection.",
        )
    uncertainty_ms = now.bridge.clock_uncertainty_ms
    if uncertainty_ms is not None and uncertainty_ms > CLOCK_MS:
        yield Problem(
            "clock uncertain",
            "warning",
            f"The tracker's clock is known to ±{uncertainty_ms:.0f} ms only.",
            "Give it a minute. If it stays, use a cable instead of a wireless network, and load the machine less.",
        )


def _of_frames(now: Snapshot) -> Iterator[Problem]:
    worker = now.worker
    if worker is None or worker.preparing:
        return
    if now.frames_silent_s is not None and now.frames_silent_s > NO_FRAMES_S:
        yield Problem(
            "no frames",
            "error",
            f"No frame has come from the worker for {now.frames_silent_s:.0f} s.",
            "Stop the session and start it again with fewer pixels.",
        )
    elif now.dropped_share > BEHIND_SHARE:
        reached = "" if worker.reached_fps is None else f": {worker.reached_fps:.1f} frames a second"
        asked = "" if worker.fps is None or not reached else f" of {worker.fps:g} asked for"
        yield Problem(
            "worker behind",
            "warning",
            f"The worker leaves out {100 * now.dropped_share:.0f} % of the frames{reached}{asked}.",
            "Choose fewer pixels, fewer frames a second, or a time budget under Plan.",
        )
    elif now.latency_p95_ms is not None and now.latency_p95_ms > LATE_MS:
        yield Problem(
            "late",
            "warning",
            f"From a sample to its light it takes up to {now.latency_p95_ms:.0f} ms (95 % of frames).",
            "Choose fewer pixels or a time budget under Plan.",
        )


def _sentence(text: str) -> str:
    return text.strip().rstrip(".") + "."
