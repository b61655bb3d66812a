"""`entoptic bridge`: publishes a person's eyes."""

from __future__ import annotations

from entoptic.services.command_line import options
from entoptic.services.process import process
from entoptic.services.process_config import BridgeConfig


@options
def bridge(config: BridgeConfig) -> None:
    """Publish a person's eyes: states at sample rate on one socket, events on another."""
    from entoptic.services.bridge import process as bridges

    with process() as (stop, log):
        bridges.run(config, stop, log)
