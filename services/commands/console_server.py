"""`entoptic console-server`: the console's page, for a host or for a bridge and a worker that run by themselves."""

from __future__ import annotations

from entoptic.services.command_line import options
from entoptic.services.process import process
from entoptic.services.process_config import FoldersConfig, PageConfig, PageLinks, ServerConfig


@options
def console_server(page: PageConfig, folders: FoldersConfig, links: PageLinks) -> None:
    """Serve the console."""
    with process() as (stop, log):
        from entoptic.services.console import process as pages

        pages.run(ServerConfig(page=page, folders=folders, links=links), stop, log)
