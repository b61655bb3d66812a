"""The same frames, to the bit, on one core and on all, on an idle machine and beside another program."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator

import pytest

from entoptic.threads import THREADS

RENDERED = """
import hashlib, json
import numpy as np
from msgspec.structs import replace
from entoptic import EFFECTS, Effects, EyePose, Planning, perceive
from entoptic.pipeline.scenes import Head, open_scene
from entoptic.tracker_bridge.wire import Eye

street, digests = open_scene("night-street"), {}

def render(name, width_px, height_px, effects):
    state, view = None, street.view_for(width_px, height_px, 104.0)
    for k in range(2):
        frame = street.frame(3.9 + 0.3 * k, view, Head(3.0 * k, k, k), (Eye.LEFT,))
        seen = perceive(
            frame, EyePose(1.0 + k, -2.0, 4.0 + 0.1 * k, 0.8), effects=effects, state=state, dt_s=0.04,
            planning=Planning(everything=True),
        )
        state = seen.state
        for what, bytes_of in (("scene", frame.rgb_cd_m2), ("linear", seen.linear), ("codes", seen.image)):
            digests[f"{name}, frame {k}, {what}"] = hashlib.sha256(np.asarray(bytes_of).tobytes()).hexdigest()

render("default", 720, 800, Effects())
for effect in EFFECTS:
    for variant, settings in effect.variants().items():
        # An odd width, which XLA divides into loops with remainders.
        render(f"{effect.name} {variant}", 241, 203, replace(Effects(), **{effect.name: settings}))
print(json.dumps(digests))
"""


@contextlib.contextmanager
def busy() -> Iterator[None]:
    loop = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        loop.kill()
        loop.wait()


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system ties no process to a core")
def test_frames_are_the_same_on_one_core_and_beside_a_busy_program() -> None:
    cores = sorted(os.sched_getaffinity(0))
    free = rendered(cores)
    with busy():
        pressed = rendered(cores[:1])
    assert len(free) > 50
    assert [name for name in free if pressed[name] != free[name]] == []


def rendered(cores: list[int]) -> dict[str, str]:
    # Compiled anew: what another process compiled would be the same for both.
    environment = {name: value for name, value in os.environ.items() if name != THREADS}
    child = subprocess.run(
        [sys.executable, "-P", "-c", f"import os; os.sched_setaffinity(0, {cores})\n{RENDERED}"],
        env=environment | {"JAX_ENABLE_COMPILATION_CACHE": "false"},
        capture_output=True, text=True, timeout=400, check=False,
    )  # fmt: skip
    assert child.returncode == 0, child.stderr
    digests: dict[str, str] = json.loads(child.stdout)
    return digests
