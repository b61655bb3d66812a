"""Key pairs (CURVE) for a bridge that listens beyond this machine, and for its readers: folders of small files.

`OUT/bridge` stays with the bridge: its own pair and `clients/`, the public key of each reader. `OUT/NAME` is for the
reader of that name: its own pair and the bridge's public key. Files are of ZeroMQ's certificate format.
"""

from __future__ import annotations

import re
import shutil
import struct
from pathlib import Path

import zmq
from zmq.auth import create_certificates, load_certificate
from zmq.utils import z85

from entoptic.errors import EntopticError
from entoptic.tracker_bridge.access import ClientKeys, ServerKeys

BRIDGE, CLIENT, CLIENTS = "bridge", "client", "clients"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")


class KeysError(EntopticError):
    """Keys cannot be made or read: the message names the file and the remedy."""


def make_bridge(out: Path) -> Path:
    """Makes a bridge's pair; returns its folder. Raises KeysError rather than overwriting one."""
    remedy = "the readers that have its public key know the bridge by it; choose another --out, or add a reader with "
    folder = _new_pair(out / BRIDGE, BRIDGE, f"{remedy}--client NAME")
    (folder / CLIENTS).mkdir(mode=0o700)
    return folder


def make_client(out: Path, name: str) -> Path:
    """Makes a reader's pair and lets the bridge of the same `out` know it; returns its folder.

    Raises KeysError rather than overwriting one.
    """
    if not _NAME.fullmatch(name) or name == BRIDGE:
        raise KeysError(f"{name!r} is no name for a reader: use up to 64 letters, digits, - and _, and not {BRIDGE!r}")
    load_server(out / BRIDGE)
    known_by = out / BRIDGE / CLIENTS / f"{name}.key"
    if known_by.exists():
        raise KeysError(f"{known_by} is there already and is not overwritten: choose another name for the reader")
    folder = _new_pair(out / name, CLIENT, "choose another name for the reader")
    for source, to in ((out / BRIDGE / f"{BRIDGE}.key", folder), (folder / f"{CLIENT}.key", known_by)):
        Path(shutil.copy(source, to)).chmod(0o600)
    return folder


def has_client(out: Path, name: str) -> bool:
    """Whether a reader of that name has its keys and the bridge knows it. Raises KeysError for a file that is none."""
    if not (out / name).is_dir() or not (out / BRIDGE / CLIENTS / f"{name}.key").is_file():
        return False
    load_server(out / BRIDGE)
    load_client(out / name)
    return True


def load_server(folder: Path) -> ServerKeys:
    """A bridge's keys. Raises KeysError."""
    public, secret = _load_pair(folder, BRIDGE)
    clients = folder / CLIENTS
    for path in clients.glob("*.key"):
        _load(path, "remove it, or make the reader's keys again")
    return ServerKeys(public, secret, clients)


def load_client(folder: Path) -> ClientKeys:
    """A reader's keys. Raises KeysError."""
    public, secret = _load_pair(folder, CLIENT)
    bridge, _ = _load(folder / f"{BRIDGE}.key", "copy it from the bridge's folder")
    return ClientKeys(public, secret, bridge)


def _new_pair(folder: Path, name: str, remedy: str) -> Path:
    """A folder with a pair, closed to others from its first moment on, so that no key in it ever lies open."""
    if folder.exists():
        raise KeysError(f"{folder} is there already and is not overwritten: {remedy}")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700)
    except OSError as error:
        raise KeysError(f"cannot make {folder}: {error.strerror}; choose another --out") from None
    for path in create_certificates(folder, name):
        Path(path).chmod(0o600)
    return folder


def _load_pair(folder: Path, name: str) -> tuple[bytes, bytes]:
    remedy = f"give the {'bridge' if name == BRIDGE else 'reader'}'s own folder of those that `entoptic keys` made"
    path = folder / f"{name}.key_secret"
    public, secret = _load(path, remedy)
    if secret is None or not _is_key(secret) or zmq.curve_public(secret) != public:
        raise KeysError(f"{path} holds no secret key, or not that of its public one: {remedy}")
    return public, secret


def _load(path: Path, remedy: str) -> tuple[bytes, bytes | None]:
    try:
        public, secret = load_certificate(path)
    except (OSError, ValueError):
        raise KeysError(f"cannot read a key from {path}: {remedy}") from None
    if not _is_key(public):
        raise KeysError(f"{path} holds no public key: {remedy}")
    return public, secret


def _is_key(text: bytes) -> bool:
    """Whether this is 32 bytes in Z85."""
    try:
        return len(z85.decode(text)) == 32
    except (KeyError, ValueError, struct.error):
        return False
