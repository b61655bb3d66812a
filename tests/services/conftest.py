"""Bridges and readers that end with their test, and figures that were saved in it."""

from collections.abc import Callable, Iterator

import pytest
from bridges import Bridge, LossyBridge
from matplotlib.figure import Figure

from entoptic.services.reader import StateReader


@pytest.fixture
def bridge() -> Iterator[Bridge]:
    made = Bridge()
    yield made
    made.publisher.close()


@pytest.fixture
def connect() -> Iterator[Callable[..., StateReader]]:
    made: list[StateReader] = []

    def reader_of(addresses: tuple[str, str]) -> StateReader:
        made.append(StateReader(*addresses))
        return made[-1]

    yield reader_of
    for reader in made:
        reader.close()


@pytest.fixture
def lossy() -> Iterator[LossyBridge]:
    made = LossyBridge()
    yield made
    made.context.destroy(linger=0)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    figures: list[Figure] = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda figure, *a, **k: (figures.append(figure), save(figure, *a, **k)))
    return figures
