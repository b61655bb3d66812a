"""The console's server as a child of a host."""

from __future__ import annotations

import dataclasses
import socket
from pathlib import Path


class WebError(Exception):
    """The console cannot be served: the message names the address and the remedy."""


@dataclasses.dataclass(frozen=True)
class Web:
    """Where the console is to be served."""

    host: str
    port: int
    token: str | None
    """Or the file that holds it."""

    def settled(self) -> Web:
        """With a port that stays the same when the server is started anew. Raises WebError where it is taken."""
        try:
            with socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET) as one:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                one.bind((self.host, self.port))
                return dataclasses.replace(self, port=one.getsockname()[1])
        except OSError as error:
            raise WebError(
                f"the console cannot be served at {self.host}, port {self.port}: {error.strerror or error}; "
                "choose another --port"
            ) from None

    @property
    def url(self) -> str:
        """What to open."""
        host = "127.0.0.1" if self.host in ("0.0.0.0", "::") else self.host
        return f"http://[{host}]:{self.port}/" if ":" in host else f"http://{host}:{self.port}/"

    def arguments(self, control: str, root: Path) -> list[str]:
        """Of the server, for a host that answers at `control`."""
        arguments = ["console-server", "--host", self.host, "--port", str(self.port), "--host-control", control]
        arguments += ["--root", str(root)]
        return arguments if self.token is None else [*arguments, "--token", self.token]
