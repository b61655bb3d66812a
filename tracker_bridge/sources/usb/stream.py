"""From a USB eye tracker's packets to samples: what the live tracker and a capture of it have in common. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import msgspec

from entoptic.tracker_bridge.clock import ArrivalClock
from entoptic.tracker_bridge.events import TrackerStatus
from entoptic.tracker_bridge.samples import NS_PER_S
from entoptic.tracker_bridge.source import Item, Tick
from entoptic.tracker_bridge.sources.hid.eye_tracker import EyeTrackerReports
from entoptic.tracker_bridge.sources.hid.gaze import samples_of, viewing
from entoptic.tracker_bridge.sources.hid.report import HidReportError, Reassembly
from entoptic.tracker_bridge.sources.hid.tracking import Tracking

COMPLAINT_EVERY_NS = NS_PER_S
"""Bad reports are told of once a second at most. Engineering choice: a noisy cable would fill the log."""


class Connection(msgspec.Struct, frozen=True):
    """What is known of a tracker once it is plugged in: all that its packets need to be understood."""

    name: str
    """For a person, with its vendor's and product's number."""
    descriptor: bytes
    """The report descriptor, as it came."""
    packet_bytes: int
    """wMaxPacketSize of the endpoint that its reports come from."""
    features: Mapping[int, bytes]
    """Feature reports by their ID, as they came."""


class PacketStream:
    """The packets of one connection, into items. A report that cannot be read is left out and told of.

    Latency: none; the samples of a report come with its last packet.

    Raises HidDescriptorError where the descriptor is broken, or is no eye tracker's.
    """

    def __init__(self, connection: Connection, clock: ArrivalClock) -> None:
        self._reports = EyeTrackerReports(connection.descriptor)
        self._reassembly = Reassembly(self._reports.inputs, connection.packet_bytes)
        configuration = self._reports.configuration(connection.features)
        self._viewing = viewing(configuration)
        self._clock = clock
        self.status = configuration.status
        """As last reported; None where the tracker does not say."""
        self.notes = (*self._reports.notes, *self._viewing.notes)
        """What had to be left out or assumed, a sentence each."""
        self.bad_count = 0
        """Reports that could not be read."""
        self._reported_ns: int | None = None
        self._unreported: list[str] = []

    def lose(self) -> None:
        """Forgets a report that was begun: its rest will not come."""
        self._reassembly.clear()

    def add(self, packet: bytes, received_ns: int) -> list[Item]:
        """What this packet, here at this time, completes: samples of one moment and a tick that ends it, or events."""
        try:
            whole = self._reassembly.add(packet)
            status, tracking = (None, None) if whole is None else self._reports.read(*whole)
        except HidReportError as error:
            return self.complain(str(error), received_ns)
        items = self._complaint(received_ns)
        if status is not None and status != self.status:
            self.status = status
            items.append(TrackerStatus(received_ns, status.is_ready, str(status)))
        if tracking is not None:
            items.extend(self._tracked(tracking, received_ns))
        return items

    def _tracked(self, tracking: Tracking, received_ns: int) -> Iterator[Item]:
        t_ns = received_ns
        if tracking.time_ns is not None:
            yield from self._clock.add(tracking.time_ns, received_ns)
            known_ns = self._clock.bridge_ns(tracking.time_ns)
            t_ns = received_ns if known_ns is None else known_ns
        yield from samples_of(tracking, self._viewing, t_ns)
        # One report is one moment: nothing has to be waited for.
        yield Tick(received_ns)

    def complain(self, text: str, now_ns: int) -> list[Item]:
        """Counts a report that cannot be read, and tells of it, with all since, at most once a second."""
        self.bad_count += 1
        self._unreported.append(text)
        return self._complaint(now_ns)

    def _complaint(self, now_ns: int) -> list[Item]:
        if not self._unreported or (self._reported_ns is not None and now_ns - self._reported_ns < COMPLAINT_EVERY_NS):
            return []
        more = f", and {len(self._unreported) - 1} more" if len(self._unreported) > 1 else ""
        text = f"{self._unreported[0]}; it was left out{more}"
        self._reported_ns = now_ns
        self._unreported.clear()
        return [TrackerStatus(now_ns, self.status is None or self.status.is_ready, text)]
