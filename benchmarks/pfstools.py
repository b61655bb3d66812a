"""Tone-mapping operators of Debian's pfstools on our frames, by the program's own commands."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]
OPERATORS = ("pfstmo_pattanaik00", "pfstmo_reinhard02")
NEEDED = ("pfsin", "pfsoutpfm", *OPERATORS)
PATIENCE_S = 120.0


def missing() -> list[str]:
    """The commands that are not installed."""
    return [command for command in NEEDED if shutil.which(command) is None]


def version() -> str:
    """Of the package where dpkg knows it, or else what the program says of itself."""
    if shutil.which("dpkg-query"):
        asked = subprocess.run(["dpkg-query", "-W", "-f=${Version}", "pfstmo"], capture_output=True, text=True)
        if asked.returncode == 0:
            return f"pfstools {asked.stdout}, Debian"
    said = subprocess.run([OPERATORS[0], "--help"], capture_output=True, text=True)
    return (said.stdout + said.stderr).partition("(")[2].partition(")")[0]


def write_pfm(path: Path, rgb: Image) -> None:
    """An image (y, x, 3) as PFM, which keeps negative numbers, NaN and denormals as they are."""
    height, width, _ = rgb.shape
    header = f"PF\n{width} {height}\n-1.0\n".encode()
    path.write_bytes(header + np.asarray(rgb[::-1], "<f4").tobytes())


def read_pfm(path: Path) -> Image:
    """An image (y, x, 3)."""
    with path.open("rb") as file:
        file.readline()
        width, height = map(int, file.readline().split())
        order = "<f4" if float(file.readline()) < 0 else ">f4"
        return np.frombuffer(file.read(), order).reshape(height, width, 3)[::-1].astype(np.float32)


def shown(command: str, frames: Sequence[Image]) -> list[Image]:
    """What an operator with its options makes of frames in cd/m², linear, 1 white; fewer if it dies."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for k, frame in enumerate(frames):
            write_pfm(folder / f"in{k:06d}.pfm", frame)
        line = f"pfsin in%06d.pfm | {command} | pfsoutpfm out%06d.pfm"
        subprocess.run(line, shell=True, cwd=folder, capture_output=True, timeout=PATIENCE_S)
        return [read_pfm(path) for path in sorted(folder.glob("out*.pfm"))]


def as_pfs(frame: Image, path: Path) -> None:
    """A frame as pfstools' own stream, so that an operator can be timed by itself."""
    source = path.with_suffix(".pfm")
    write_pfm(source, frame)
    with path.open("wb") as file:
        subprocess.run(["pfsin", str(source)], stdout=file, check=True, timeout=PATIENCE_S)


def run_on(operator: str, stream: Path) -> None:
    """The operator alone: reads a stream, throws its result away."""
    with stream.open("rb") as file:
        subprocess.run(
            [operator], stdin=file, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True, timeout=PATIENCE_S
        )
