"""The errors that a person can do something about."""

from __future__ import annotations


class EntopticError(Exception):
    """What was wrong, where, and what to do: one line that the command line prints as it is."""


class OutputError(EntopticError):
    """A file cannot be written: the message names it and the remedy."""
