"""What the command line says of where a session is and of who may see it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import msgspec

from entoptic.errors import EntopticError
from entoptic.services.console.live import Places
from entoptic.services.console.security import Rules, new_token
from entoptic.services.ipc.addresses import Addresses
from entoptic.tracker_bridge.access import ClientKeys, is_local

LEAST_TOKEN = 16
"""Characters: fewer can be guessed."""


class ConsoleError(EntopticError):
    """The console cannot be served: the message names the option and the remedy."""


def places(
    host_control: str | None,
    given: Mapping[str, str | None],
    bridge_keys: ClientKeys | None,
    worker_keys: ClientKeys | None,
) -> Places:
    """A host, or all addresses of a bridge and a worker. Raises ConsoleError."""
    named = {name: address for name, address in given.items() if address is not None}
    if host_control is not None:
        if named:
            raise ConsoleError("--host-control says where all is: leave the other addresses out")
        return Places(host_control)
    if missing := [f"--{name}" for name in given if name not in named]:
        raise ConsoleError(f"{', '.join(missing)} missing: give --host-control, or all addresses of bridge and worker")
    # Every event says where lost ones are to be had.
    return Places(None, msgspec.convert({**named, "replay": ""}, Addresses), bridge_keys, worker_keys)


def rules_for(
    host: str, given: str | None, names: Sequence[str], *, no_token: bool, may_make: bool
) -> tuple[Callable[[int], Rules], str | None]:
    """Who may come in, by the port; and a token that was made just now, if one was. Raises ConsoleError.

    `given`: a token, or the file that holds one.
    """
    token = made = None
    if given is not None:
        token = _token_of(given)
    elif not no_token and not is_local(f"tcp://{host}:0"):
        if not may_make:
            raise ConsoleError(f"--host {host} can be reached from other machines: give --token or its file")
        token = made = new_token()
    known = (*(name.lower() for name in names), *(() if token is None else (host.lower(),)))
    return lambda port: Rules(token, known, port), made


def _token_of(given: str) -> str:
    token, path = given, Path(given)
    if path.is_file():
        try:
            token = path.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise ConsoleError(f"--token {path}: {getattr(error, 'strerror', None) or 'no text'}") from None
    elif path.suffix or len(path.parts) > 1:
        raise ConsoleError(
            f"--token {given}: there is no such file; name one that holds a token, or give the token itself"
        )
    if len(token) < LEAST_TOKEN or not token.isascii() or not token.replace("-", "").replace("_", "").isalnum():
        raise ConsoleError(f"--token: a token, or what its file holds, has {LEAST_TOKEN} or more letters and digits")
    return token
