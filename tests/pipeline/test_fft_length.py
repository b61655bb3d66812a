import os
import subprocess
import sys

import pytest
import scipy.fft
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.fft_length import IN_REGISTER, SPLIT_ABOVE, Lines, fft_length
from entoptic.threads import THREADS

ROWS = [fft_length(least, "complex64") for least in (64, 320, 576, 800, 1600)]
TRANSFORMED = f"""
import hashlib
import jax.numpy as jnp, numpy as np
import entoptic.pipeline
print(hashlib.sha256(b"".join(
    np.asarray(part).tobytes()
    for rows in {ROWS}
    for image in [jnp.asarray(np.random.default_rng(rows).standard_normal((3, rows, 90), np.float32))]
    for light in [jnp.fft.rfft2(image)]
    for part in (light, jnp.fft.irfft2(light))
)).hexdigest())
"""


@given(st.integers(0, 5000), st.sampled_from(["real", "complex64", "complex128"]))
def test_a_length_is_fast_near_and_never_split(least: int, lines: Lines) -> None:
    length = fft_length(least, lines)
    assert least <= length <= max(1.1 * least, 16)
    assert scipy.fft.next_fast_len(length) == length
    assert lines == "real" or length <= SPLIT_ABOVE or length % IN_REGISTER[lines]


@pytest.mark.parametrize("threads", ["3", "5"])
def test_transforms_of_such_lengths_are_the_same_on_any_number_of_threads(threads: str) -> None:
    assert transformed("1") == transformed(threads)


def transformed(threads: str) -> str:
    command = [sys.executable, "-P", "-c", TRANSFORMED]
    environment = os.environ | {THREADS: threads, "JAX_ENABLE_COMPILATION_CACHE": "false"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100, check=True).stdout
