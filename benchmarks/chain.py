"""Samples a second through the eye side, from source to encoded states."""

from __future__ import annotations

import time

from tracker_bridge import bridge, wire
from tracker_bridge.sources import open_source
from tracker_bridge.sources.simulated import SimulatedSettings


def main() -> None:
    """Prints one line."""
    samples = list(open_source("simulated", simulated=SimulatedSettings(seconds=60.0)).samples())
    rates = []
    for _ in range(5):
        begun = time.perf_counter()
        for state, events in bridge.states_of(iter(samples)):
            wire.encode(state)
            for event in events:
                wire.encode(event)
        rates.append(len(samples) / (time.perf_counter() - begun))
    print(f"\nchain: {sorted(rates)[2]:,.0f} samples/s, from samples to encoded states, one core")


if __name__ == "__main__":
    main()
