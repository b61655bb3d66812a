"""What a worker leaves behind: frames, render log, plan.csv, picture pairs for the report, and a summary of it all."""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path

import msgspec
import numpy as np

from entoptic.atomic_file import write_bytes
from entoptic.pipeline import Encoding, as_displayed
from entoptic.pipeline.effects.encode import encode
from entoptic.pipeline.sinks.images import still_path, write_exr, write_png, write_still
from entoptic.pipeline.sinks.video import Encoder, film
from entoptic.pipeline.sinks.video_parts import Part
from entoptic.services.config import Save
from entoptic.services.ipc.messages import LatencyMs
from entoptic.services.rendering import Rendered
from entoptic.services.results import kept, render_log
from entoptic.services.results.appended import Appended, row, whole_rows
from entoptic.services.results.folder import WORKER
from entoptic.services.results.render_log import Begun, FrameRecord, Perceive, RenderLog, Resumed
from entoptic.services.results.tally import PLAN, Reception, Tally, WorkerSummary, plan_columns
from entoptic.services.settings import Settings

KEY_FRAMES = 6
"""How many frames of a session of known length are kept as picture pairs."""
KEY_EVERY_S = 5.0
"""Between pairs where the length is not known; twice that after PAIRS of them, and so on."""
PAIRS = 12


class Results(contextlib.ExitStack):
    """Everything that frames leave in a folder.

    A context. The film of a session that is not live is whole only if it is left in peace; the parts of a live one's,
    and all else, can be read at every moment. In a folder that another process of a live session began, this goes on
    where that one was: it reads that one's log and rows first, 5 s for an hour of them.
    """

    def __init__(self, folder: Path, begun: Begun, save: frozenset[Save], *, frames: int | None = None) -> None:
        """`frames` is how many are to come, if that is known. Raises OSError, RenderLogError for what lies there."""
        super().__init__()
        self._folder, self._begun, self._save = folder, begun, save
        self._every = max(round(KEY_EVERY_S * begun.view.fps) if frames is None else frames // KEY_FRAMES, 1)
        self._pair_due = self._every // 2
        self._pairs: list[dict[str, object]] = []
        self._zero_s, self._display = begun.zero_s, begun.perception.display
        self._first: int | None = None
        """Number of the frame at the tables' zero; known with the first frame."""
        self._tally = Tally(begun.view.fps)
        self._hash = hashlib.sha256()
        self._video: Encoder | None = None
        self._part: Part | None = None
        self._part_display = self._display
        with contextlib.ExitStack() as files:
            self._open(files)
            self.push(files.pop_all())
        self.callback(self._end_part)

    def _open(self, files: contextlib.ExitStack) -> None:
        record, plan = self._folder / render_log.FILE, self._folder / PLAN
        before = RenderLog(record) if self._begun.live and record.exists() and record.stat().st_size else None
        last = None if before is None else before.last()
        # The last word of a worker before this one is none any more.
        (self._folder / WORKER).unlink(missing_ok=True)
        self._render_log = files.enter_context(Appended(record, 0 if before is None else before.whole_bytes))
        self._plan = files.enter_context(Appended(plan, 0 if before is None else whole_rows(plan)))
        if not self._plan.size:
            self._plan.write(row(plan_columns(self._begun.eyes)))
        if before is None:
            self._render_log.write(kept.encode(self._begun))
            return
        self._tally = Tally.read(plan, self._begun.view.fps)
        with contextlib.suppress(OSError, ValueError):
            self._pairs = json.loads((self._folder / "key_frames" / "key_frames.json").read_bytes())
            self._pair_due = round(float(str(self._pairs[-1]["t_s"])) * self._begun.view.fps) + self._pair_gap
        if last is not None:
            self._hash.update(last.sha256)
        self._record(Resumed(self._zero_s, self._begun.perception, self._begun.costs, self._begun.state))

    @property
    def folder(self) -> Path:
        """Where it all lies."""
        return self._folder

    @property
    def digest(self) -> bytes:
        """SHA-256 of all perceived frames' code values so far."""
        return self._hash.digest()

    @property
    def _pair_gap(self) -> int:
        return int(self._every * 2 ** (len(self._pairs) // PAIRS))

    def _record(self, record: render_log.Record) -> None:
        self._render_log.write(kept.encode(record))

    def perceive(self, perception: Settings) -> None:
        """Settings change, from the next frame on."""
        self._record(Perceive(perception))
        self._display = perception.display

    def resume(self, record: Resumed) -> None:
        """From here on it is what a worker that was started again rendered."""
        self._record(record)
        self._zero_s, self._display, self._first = record.zero_s, record.perception.display, None
        self._hash = hashlib.sha256(self.digest)

    def check(self) -> None:
        """Raises OSError where somebody deleted or moved the files: writing would go on into nowhere."""
        self._render_log.check()
        self._plan.check()

    def add(self, rendered: Rendered, record: FrameRecord) -> None:
        """Keeps one more frame, and what it was rendered from. Raises OSError or OutputError where it cannot."""
        t_s = rendered.t_s - self._zero_s
        if self._first is None:
            self._first = min(rendered.frame_number, rendered.frame_number - round(t_s * self._begun.view.fps))
        index = rendered.frame_number - self._first
        self._hash.update(rendered.perceived.image.tobytes())
        self._record(msgspec.structs.replace(record, sha256=self.digest))
        image = side_by_side(rendered.perceived.image)
        if Save.VIDEO in self._save:
            self._film(image, index)
        name = f"{rendered.frame_number:06d}"
        if Save.PNG in self._save:
            still = still_path(_made(self._folder / "frames") / name, self._display)
            write_still(still, image, self._display)
        if Save.EXR in self._save:
            linear = side_by_side(np.asarray(rendered.perceived.linear).transpose(0, 2, 3, 1))
            write_exr(_made(self._folder / "frames") / f"{name}.exr", linear)
        if index >= self._pair_due:
            self._keep_pair(rendered, name, t_s)
            while self._pair_due <= index:
                self._pair_due += self._pair_gap

    def note(self, rendered: Rendered, latency: LatencyMs | None = None) -> None:
        """Writes the frame's row, when all that it says has happened. Raises OSError where it cannot."""
        cells = self._tally.add(rendered, self._begun, rendered.t_s - self._zero_s, latency)
        self._plan.write(row(cells))

    def _film(self, image: np.ndarray, index: int) -> None:
        height, width = image.shape[:2]
        path, fps = self._folder, self._begun.view.fps
        if not self._begun.live:
            if self._video is None:
                self._video = self.enter_context(film(path / "perceived.mp4", (width, height), fps, self._display))
            self._video.write(image, index)
            return
        if self._display != self._part_display:
            self._end_part()
        self._part_display = self._display
        if self._display.encoding is Encoding.LINEAR:
            return  # a film has no such frames
        if self._part is None:
            number = max(map(_number, film_parts(path)), default=0) + 1
            self._part = Part(path / f"perceived-{number}.mp4", width, height, fps, self._display, index)
        self._part.write(image, index)

    def _end_part(self) -> None:
        if self._part is not None:
            part, self._part = self._part, None
            part.close()

    def _keep_pair(self, rendered: Rendered, name: str, t_s: float) -> None:
        folder = _made(self._folder / "key_frames")
        # For a web page, whatever the display.
        page = msgspec.structs.replace(self._display, encoding=Encoding.SRGB)
        displayed, perceived = as_displayed(rendered.frame, page), encode(rendered.perceived.linear, page)
        write_png(folder / f"{name}_displayed.png", side_by_side(displayed))
        write_png(folder / f"{name}_perceived.png", side_by_side(perceived))
        scene = side_by_side(np.asarray(rendered.frame.rgb_cd_m2).transpose(0, 2, 3, 1))
        write_exr(folder / f"{name}_scene.exr", scene)
        self._pairs.append({"frame": rendered.frame_number, "t_s": t_s})
        write_bytes(folder / "key_frames.json", json.dumps(self._pairs).encode())

    def summary(self, reception: Reception | None, warm_up_s: float | None) -> WorkerSummary:
        """All of it in figures."""
        return self._tally.summary(reception, self._hash.hexdigest(), warm_up_s)


def film_parts(folder: Path) -> list[Path]:
    """The parts of a film, in order."""
    return sorted(folder.glob("perceived-[0-9]*.mp4"), key=_number)


def _number(part: Path) -> int:
    number = part.stem.rpartition("-")[2]
    return int(number) if number.isdecimal() else 0


def side_by_side(images: np.ndarray) -> np.ndarray:
    """Images of shape (eye, y, x, 3) beside each other: (y, eye·x, 3)."""
    return np.concatenate(list(images), axis=1)


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder
