"""How the processes are, and what is wrong: the record that each answers `status` with (requests.GiveStatus)."""

from __future__ import annotations

import msgspec


class Gap(msgspec.Struct, frozen=True):
    """While a process was not there; on the monotonic clock."""

    process: str
    from_ns: int
    to_ns: int | None
    """When it was ready again; None while it is not."""
    why: str

    def since(self, start_ns: int) -> dict[str, object]:
        """As it is told: seconds from a start."""
        return {
            "process": self.process,
            "from_s": round((self.from_ns - start_ns) * 1e-9, 3),
            "to_s": None if self.to_ns is None else round((self.to_ns - start_ns) * 1e-9, 3),
            "why": self.why,
        }
