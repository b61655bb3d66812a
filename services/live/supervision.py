"""When a process that crashed is started again, and when it is given up; pure, so that no process is needed to test it.

A crash is any end that nobody asked for. The first one is followed by a new start after FIRST_S, each further one after
twice as long, LONGEST_S at most; a process that ran for WINDOW_S begins from the beginning. One that crashed MOST times
within WINDOW_S without working for WORKED_S in between, or as often in a row without ever being ready, is given up.
"""

from __future__ import annotations

from typing import Final

import msgspec

FIRST_S: Final = 0.2
LONGEST_S: Final = 5.0
WINDOW_S: Final = 30.0
MOST: Final = 5
WORKED_S: Final = 2.0
"""A process that was ready for so long did its work: its crash does not count. Engineering choice: dozens of frames."""


class Restarts(msgspec.Struct, frozen=True):
    """What is remembered of a process's crashes; times are of any clock in seconds."""

    crashes_s: tuple[float, ...] = ()
    """Those within the last WINDOW_S, of processes that had not worked."""
    in_a_row: int = 0
    """Without WINDOW_S of work between them."""
    never_ready: int = 0
    """In a row, before it was ready."""

    def crashed(self, now_s: float, ran_s: float, worked_s: float | None) -> Restarts:
        """After one more crash; `ran_s` is how long the process had run, `worked_s` since it was ready, if it was."""
        recent = tuple(one for one in self.crashes_s if now_s - one < WINDOW_S)
        return Restarts(
            recent if worked_s is not None and worked_s >= WORKED_S else (*recent, now_s),
            1 if ran_s >= WINDOW_S else self.in_a_row + 1,
            0 if worked_s is not None else self.never_ready + 1,
        )

    @property
    def given_up(self) -> bool:
        """Whether it is not to be started again."""
        return len(self.crashes_s) >= MOST or self.never_ready >= MOST

    @property
    def delay_s(self) -> float:
        """From the last crash to the new start."""
        return min(FIRST_S * 2.0 ** max(self.in_a_row - 1, 0), LONGEST_S)
