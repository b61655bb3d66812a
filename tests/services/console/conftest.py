from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from console_session import MadeUpSession, Served

from entoptic.services.console import problems
from entoptic.services.console.live import Places


@pytest.fixture
def session() -> Iterator[MadeUpSession]:
    made = MadeUpSession()
    yield made
    made.close()


@pytest.fixture
def serve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Served]]:
    # How full this machine's disk is is no matter of these tests.
    monkeypatch.setattr(problems, "LITTLE_BYTES", 0)
    served = []

    def start(places: Places | None = None, **more: object) -> Served:
        served.append(Served(tmp_path, places or Places("tcp://127.0.0.1:9"), **more))  # type: ignore[arg-type]
        return served[-1]

    yield start
    for each in served:
        each.close()


@pytest.fixture
def attached(serve: Callable[..., Served], session: MadeUpSession) -> Served:
    return serve(Places(None, session.addresses))


@pytest.fixture
def hosted(serve: Callable[..., Served], session: MadeUpSession) -> Served:
    return serve(Places(session.host))
