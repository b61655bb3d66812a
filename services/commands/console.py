"""`entoptic console`: a page in a browser from which sessions are started, watched and recorded."""

from __future__ import annotations

from entoptic.services.command_line import options
from entoptic.services.process import Stop, leave, prepare_jax
from entoptic.services.process_config import FoldersConfig, PageConfig
from entoptic.services.terminal import console as terminal


@options
def console(page: PageConfig, folders: FoldersConfig) -> None:
    """Serve a page from which sessions are started, watched, calibrated and recorded, until Ctrl-C."""
    stop = Stop().on_signals()
    prepare_jax(renders=False)
    from entoptic.services.live import foreground
    from entoptic.services.live.web import Web

    foreground.idle(Web(page, folders), stop, terminal)
    leave(0)
