"""The pipeline process: renders what a bridge publishes.

live.py        frames by the clock, for as long as it is asked to
requests.py    what a live worker is asked, from a thread of its own
recording.py   what it records
checkpoint.py  what a worker that is started again goes on from
publish.py     its socket: each thing is made while somebody wants it
engine.py      from what was perceived to what a game engine needs
"""
