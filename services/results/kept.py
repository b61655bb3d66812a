"""Records as msgpack that come back to the bit, arrays included: what a worker remembers, on disk."""

from __future__ import annotations

from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import msgspec
import numpy as np

Record = TypeVar("Record")


class _Array(msgspec.Struct, frozen=True):
    dtype: str
    shape: tuple[int, ...]
    data: bytes


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | jax.Array):
        array = np.ascontiguousarray(value)
        return _Array(array.dtype.str, array.shape, array.tobytes())
    if isinstance(value, np.float64):
        return float(value)
    raise TypeError(f"{type(value).__name__} cannot be kept")


def _array(kind: Any, value: object) -> object:
    kept = msgspec.convert(value, _Array)
    array = np.frombuffer(kept.data, np.dtype(kept.dtype)).reshape(kept.shape)
    return jnp.asarray(array) if kind.array_type is jax.Array else array


_encoder = msgspec.msgpack.Encoder(enc_hook=_plain)


def encode(record: object) -> bytes:
    """One msgpack value."""
    return _encoder.encode(record)


def decoder(kind: type[Record] | Any) -> msgspec.msgpack.Decoder[Record]:
    """Reads such values. It raises msgspec.DecodeError, and ValueError or TypeError for an array that is none."""
    return msgspec.msgpack.Decoder(kind, dec_hook=_array)
