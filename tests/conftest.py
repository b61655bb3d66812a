import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import structlog
from hypothesis import settings

from entoptic.services.process import cache_folder

# Before JAX is imported. What was compiled once is compiled for all tests, and for the program: a third of their time.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_folder() / "compiled"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")

DATA = Path(__file__).parents[2] / "shared" / "data"


def pytest_configure(config: pytest.Config) -> None:
    """Few examples, the same each time, for `make test`; many, drawn anew, where slow tests run too."""
    settings.register_profile("quick", deadline=None, max_examples=25, derandomize=True)
    settings.register_profile("thorough", deadline=None, max_examples=250, print_blob=True)
    settings.load_profile("quick" if "not slow" in config.option.markexpr else "thorough")


@pytest.fixture
def shared() -> Callable[[str], Path]:
    """The path of a real recording or frame that is not part of the project; skips the test where it is absent."""

    def path_of(name: str) -> Path:
        path = DATA / name
        if not path.exists():
            pytest.skip(f"{name} is not here")
        return path

    return path_of


@pytest.fixture(autouse=True)
def _logs_end_with_their_test() -> Iterator[None]:
    """A command that ran in a test logs to that test's standard error, which is closed behind it."""
    yield
    structlog.reset_defaults()


MUCH_BYTES = 1_200_000_000
"""A worker that holds more gives back what it can."""


@pytest.fixture(scope="module", autouse=True)
def _compiled_code_ends_with_its_module() -> Iterator[None]:
    """What JAX compiled is kept on disk; in memory it would add up to gigabytes over a worker's modules."""
    yield
    _give_memory_back()


@pytest.fixture(autouse=True)
def _no_test_leaves_much_memory_behind() -> Iterator[None]:
    yield
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        if pages * os.sysconf("SC_PAGESIZE") > MUCH_BYTES:
            _give_memory_back()


def _give_memory_back() -> None:
    if "jax" not in sys.modules:
        return
    sys.modules["jax"].clear_caches()
    gc.collect()
    if sys.platform == "linux":
        ctypes.CDLL(None).malloc_trim(0)  # glibc keeps what was freed


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: many tests wait for a process, a socket or a clock."""
    return len(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)) + 1
