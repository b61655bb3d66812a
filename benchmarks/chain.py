"""Samples a second through the eye side, from source to encoded states."""

from __future__ import annotations

import time

from entoptic.tracker_bridge import wire
from entoptic.tracker_bridge.chain import records_of
from entoptic.tracker_bridge.samples import EyeState
from entoptic.tracker_bridge.sources import open_source
from entoptic.tracker_bridge.sources.simulated.eyes import SimulatedSettings


def main() -> None:
    """Prints one line."""
    samples = list(open_source("simulated", simulated=SimulatedSettings(seconds=60.0)).samples())
    rates = []
    for _ in range(5):
        begun = time.perf_counter()
        for sequence, record in enumerate(records_of(samples)):
            if isinstance(record, EyeState):
                wire.encode_state(record)
            else:
                wire.encode_event(record, stream=1, sequence=sequence, replay_port=1)
        rates.append(len(samples) / (time.perf_counter() - begun))
    print(f"\nchain: {sorted(rates)[2]:,.0f} samples/s, from samples to encoded states, one core")


if __name__ == "__main__":
    main()
