"""The console's server as a child of a host."""

from __future__ import annotations

import dataclasses
import socket

from msgspec.structs import replace

from entoptic.services.console.access import ConsoleError, rules_for
from entoptic.services.process_config import FoldersConfig, PageConfig, PageLinks, ServerConfig


@dataclasses.dataclass(frozen=True)
class Web:
    """Where the console is to be served, and what it is given."""

    page: PageConfig
    folders: FoldersConfig = FoldersConfig()  # noqa: RUF009 - frozen

    def settled(self) -> Web:
        """With a port that stays the same when the server is started again, and a token where it needs one.

        Raises ConsoleError.
        """
        page = self.page
        _, made = rules_for(page.host, page.token, page.names, no_token=False, may_make=True)
        try:
            with socket.socket(socket.AF_INET6 if ":" in page.host else socket.AF_INET) as one:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                one.bind((page.host, page.port))
                port = one.getsockname()[1]
        except OSError as error:
            raise ConsoleError(
                f"the console cannot be served at {page.host}, port {page.port}: {error.strerror or error}; "
                "choose another --port"
            ) from None
        return dataclasses.replace(self, page=replace(page, port=port, token=page.token if made is None else made))

    @property
    def url(self) -> str:
        """What to open."""
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.page.host, self.page.host)
        return f"http://{f'[{host}]' if ':' in host else host}:{self.page.port}/"

    def config(self, control: str) -> ServerConfig:
        """Of the server, for a host that answers at `control`."""
        return ServerConfig(page=self.page, folders=self.folders, links=PageLinks(host_control=control))
