"""Looks for inputs that make a decoder raise anything but its named errors, led by coverage: `make fuzz`.

    python tests/fuzz/run.py --seconds 30 [DECODER …]

Needs atheris, which has wheels for Linux alone. Each decoder runs in a process of its own; an input that breaks one is
kept beside this file as crash-… and fails the run.
"""

from __future__ import annotations

import argparse
import contextlib
import subprocess
import sys
import tempfile
from pathlib import Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("decoders", nargs="*", metavar="DECODER", help="all unless given")
    parser.add_argument("--seconds", type=int, default=30, help="for each decoder")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        fuzz(given.decoders[0], given.seconds)
        return
    from decoders import decoders

    failed = []
    for name in given.decoders or decoders():
        command = [sys.executable, __file__, "--one", "--seconds", str(given.seconds), name]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        last = next((line for line in reversed(done.stderr.splitlines()) if line.startswith(("Done", "#"))), "")
        print(f"{name}: {'failed' if done.returncode else 'only named errors'}   {last}", flush=True)
        if done.returncode:
            failed.append(name)
            print(done.stderr[-3000:])
    sys.exit(f"{', '.join(failed)}: see above" if failed else 0)


def fuzz(name: str, seconds: int) -> None:
    import atheris

    # Before the first import: what is imported already is not led by coverage.
    with atheris.instrument_imports(include=["entoptic"]):
        from decoders import decoders
    decoder = decoders()[name]

    def once(data: bytes) -> None:
        with contextlib.suppress(*decoder.may_raise):
            decoder.read(data)

    with tempfile.TemporaryDirectory() as corpus:
        for k, good in enumerate(decoder.good):
            (Path(corpus) / str(k)).write_bytes(good)
        here = Path(__file__).parent
        flags = [f"-max_total_time={seconds}", "-max_len=8192", f"-artifact_prefix={here}/", "-rss_limit_mb=2048"]
        atheris.Setup([sys.argv[0], *flags, corpus], once)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
