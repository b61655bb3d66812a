"""A simulated USB tracker that plays what a test can count, in time that passes when somebody waits."""

from collections.abc import Iterator, Sequence

from entoptic.tracker_bridge.samples import Eye, GazeSample, PupilSample
from entoptic.tracker_bridge.source import Item, SourceInfo
from entoptic.tracker_bridge.sources.usb.tracker import UsbTracker
from entoptic.tracker_bridge.usb_twin.backend import TwinBackend, open_usb_simulated

START_NS = 10**15
Sample = PupilSample | GazeSample


class Time:
    """Time that passes when somebody waits."""

    def __init__(self) -> None:
        self.t_ns = START_NS

    def now_ns(self) -> int:
        return self.t_ns

    def wait_ns(self, duration_ns: int) -> None:
        self.t_ns += duration_ns


class Played:
    """A recording of as many moments as a test needs, 100 a second."""

    def __init__(self, seconds: float) -> None:
        self.count = round(100 * seconds)
        self.info = SourceInfo("test", 0, 10_000_000 * self.count)

    def samples(self) -> Iterator[Item]:
        for at in range(self.count):
            for eye in Eye:
                yield PupilSample(10_000_000 * at, eye, 3.0 + at % 100 / 100, 0.9)
            yield GazeSample(10_000_000 * at, None, at % 10, 0.0, 0.9)


def tracker(seconds: float, *faults: str) -> UsbTracker:
    return open_usb_simulated(Played(seconds), faults, timekeeper=Time())


def over(backend: TwinBackend, time: Time, usb_id: str | None = None) -> UsbTracker:
    return UsbTracker(usb_id, backend=backend, timekeeper=time, is_over=backend.is_over)


def samples_in(items: Sequence[Item]) -> list[Sample]:
    return [item for item in items if isinstance(item, Sample)]
