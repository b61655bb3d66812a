"""Whose page asks: a browser lets any page connect to this machine, but tells whose it is."""

from __future__ import annotations

from urllib.parse import urlsplit

from starlette.datastructures import Headers


def is_own_origin(headers: Headers) -> bool:
    """Whether a request comes from a page of the host that it asks."""
    try:
        parts = urlsplit(headers.get("origin", ""))
    except ValueError:  # no address at all
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == headers.get("host", "").lower()
