import ctypes
import functools
import gc
import os
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import structlog
from hypothesis import settings

from entoptic.services.process import compiled_folder

# Before JAX is imported. What was compiled once is compiled for all tests, and for the program: a third of their time.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(compiled_folder()))
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


def _clear_caches(module: types.ModuleType) -> None:
    for value in list(vars(module).values()):
        if isinstance(value, functools._lru_cache_wrapper):
            value.cache_clear()


class _Memory:
    """What JAX compiled is kept on disk, and kernels are soon computed: in memory they would add up to gigabytes."""

    WORTHWHILE_BYTES = 700_000_000
    """That have been added since memory was given back; less is not worth compiling anew."""

    def __init__(self) -> None:
        self._kept_bytes = 0

    def give_back_beyond(self, most_bytes: int) -> None:
        """Frees what can be had again where this process holds more, on Linux, where that is known."""
        if sys.platform != "linux" or "jax" not in sys.modules:
            return
        if self._held_bytes() < max(most_bytes, self._kept_bytes + self.WORTHWHILE_BYTES):
            return
        sys.modules["jax"].clear_caches()
        for name in [name for name in sys.modules if name.startswith("entoptic.")]:
            _clear_caches(sys.modules[name])
        gc.collect()
        ctypes.CDLL(None).malloc_trim(0)  # glibc keeps what was freed
        self._kept_bytes = self._held_bytes()

    @staticmethod
    def _held_bytes() -> int:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE")


_MEMORY = _Memory()


@pytest.fixture(scope="module", autouse=True)
def _modules_end_with_little_memory(request: pytest.FixtureRequest) -> Iterator[None]:
    yield
    _clear_caches(request.module)
    _MEMORY.give_back_beyond(1_300_000_000)


@pytest.fixture(autouse=True)
def _tests_end_with_no_more_than_others_need() -> Iterator[None]:
    yield
    _MEMORY.give_back_beyond(1_700_000_000)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: many tests wait for a process, a socket or a clock."""
    return len(os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else range(os.cpu_count() or 1)) + 1
