"""The console's server as a child of a host."""

from __future__ import annotations

import dataclasses
import socket
from pathlib import Path

from entoptic.services.console.access import ConsoleError, rules_for


@dataclasses.dataclass(frozen=True)
class Web:
    """Where the console is to be served, and what it is given."""

    host: str
    port: int
    token: str | None = None
    """Or the file that holds it."""
    observers: Path = Path("observers")
    inputs: Path | None = None
    names: tuple[str, ...] = ()
    """By which it may be called, beside this machine's own."""

    def settled(self) -> Web:
        """With a port that stays the same when the server is started anew, and a token where it needs one.

        Raises ConsoleError.
        """
        _, made = rules_for(self.host, self.token, self.names, no_token=False, may_make=True)
        try:
            with socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET) as one:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                one.bind((self.host, self.port))
                port = one.getsockname()[1]
        except OSError as error:
            raise ConsoleError(
                f"the console cannot be served at {self.host}, port {self.port}: {error.strerror or error}; "
                "choose another --port"
            ) from None
        return dataclasses.replace(self, port=port, token=self.token if made is None else made)

    @property
    def url(self) -> str:
        """What to open."""
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)
        return f"http://{f'[{host}]' if ':' in host else host}:{self.port}/"

    def arguments(self, control: str, root: Path, scratch: Path) -> list[str]:
        """Of the server, for a host that answers at `control`; `scratch` is its folder, closed to others."""
        arguments = ["console-server", "--host", self.host, "--port", str(self.port), "--host-control", control]
        arguments += ["--root", str(root), "--observers", str(self.observers)]
        arguments += [] if self.inputs is None else ["--inputs", str(self.inputs)]
        for name in self.names:
            arguments += ["--allow-host", name]
        if self.token is None:
            return arguments
        # Anybody on this machine can read a command line.
        token = Path(self.token)
        if not token.is_file():
            token = scratch / "token"
            token.touch(mode=0o600)
            token.write_text(self.token, encoding="utf-8")
        return [*arguments, "--token", str(token)]
