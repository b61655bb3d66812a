"""Who may hear the bridge: loopback alone, or whoever has a key (CURVE, with ZeroMQ's ZAP asking for each)."""

from __future__ import annotations

import ipaddress
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import zmq
from zmq.auth import load_certificate
from zmq.utils import z85

from entoptic.errors import EntopticError

ZAP_ADDRESS = "inproc://zeromq.zap.01"
"""Where libzmq asks whether a client may come in (ZeroMQ RFC 27)."""
ZAP_DOMAIN = "entoptic"
"""A socket has to have one for libzmq to shut everybody out while nobody answers there; it lets everybody in else."""


class OpenAddressError(EntopticError):
    """An address would let anybody on the network read a person's eyes: the message names it and the remedy."""


class ServerKeys(msgspec.Struct, frozen=True):
    """What a bridge needs to let in whom it knows."""

    public: bytes
    """40 characters of Z85, as all keys here."""
    secret: bytes
    clients: Path
    """A folder with a public key a client, *.key; read again for every client that comes, so that one can be added or
    removed while the bridge runs."""

    def use(self, socket: zmq.Socket[bytes]) -> None:
        """For a socket that is not bound yet, where `zap_reply` is asked; without an answer nobody gets in."""
        socket.setsockopt_string(zmq.ZAP_DOMAIN, ZAP_DOMAIN)
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)
        socket.curve_server = True
        socket.curve_publickey, socket.curve_secretkey = self.public, self.secret


class ClientKeys(msgspec.Struct, frozen=True):
    """What a reader needs to be let in, and to know the bridge."""

    public: bytes
    secret: bytes
    bridge: bytes
    """The bridge's public key."""

    def use(self, socket: zmq.Socket[Any]) -> None:
        """For a socket that is not connected yet."""
        socket.curve_publickey, socket.curve_secretkey, socket.curve_serverkey = self.public, self.secret, self.bridge


def is_local(address: str) -> bool:
    """Whether nobody outside this machine can connect to an address, be it that it is none at all."""
    transport, _, place = address.partition("://")
    if not place or transport in ("ipc", "inproc"):
        return True
    host = place.rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def refuse_open(addresses: Sequence[str]) -> None:
    """Raises OpenAddressError for the first address that is not local."""
    for address in addresses:
        if not is_local(address):
            raise OpenAddressError(
                f"{address} can be reached from other machines, and whoever connects there could read this person's "
                "eyes: make keys with `entoptic keys --out keys` and give the bridge --keys keys/bridge, or listen on "
                "this machine alone, tcp://127.0.0.1:*"
            )


def zap_reply(request: Sequence[bytes], keys: ServerKeys) -> list[bytes]:
    """What to answer libzmq (RFC 27): 200 for a client whose public key lies in the folder, 400 for any other."""
    version, request_id, _domain, _address, _identity, mechanism, *credentials = request
    if mechanism == b"CURVE" and len(credentials) == 1 and is_known(z85.encode(credentials[0]), keys.clients):
        return [version, request_id, b"200", b"OK", b"", b""]
    return [version, request_id, b"400", b"unknown key", b"", b""]


def is_known(public: bytes, clients: Path) -> bool:
    """Whether a public key lies in the folder; what cannot be read there, be it the folder, lets nobody in."""
    try:
        paths = list(clients.glob("*.key"))
    except OSError:
        return False
    for path in paths:
        try:
            if load_certificate(path)[0] == public:
                return True
        except (OSError, ValueError):
            continue
    return False


class Authenticator:
    """Answers libzmq from a thread of its own until the context ends. To be made before any socket is bound."""

    def __init__(self, context: zmq.Context[zmq.Socket[bytes]], keys: ServerKeys) -> None:
        socket = context.socket(zmq.REP)
        socket.setsockopt(zmq.LINGER, 0)
        socket.bind(ZAP_ADDRESS)
        self._thread = threading.Thread(target=self._serve, args=(socket, keys), name="authenticator", daemon=True)
        self._thread.start()

    @staticmethod
    def _serve(socket: zmq.Socket[bytes], keys: ServerKeys) -> None:
        try:
            while True:
                socket.send_multipart(zap_reply(socket.recv_multipart(), keys))
        except zmq.ContextTerminated:
            pass
        finally:
            # Whatever happens: the context waits for its sockets to be closed.
            socket.close(linger=0)

    def join(self) -> None:
        """Waits for the thread; once the context is being ended."""
        self._thread.join()
