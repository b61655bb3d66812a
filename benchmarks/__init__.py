"""Timings, run by hand and by `make bench`: each prints a table of medians of interleaved runs."""
