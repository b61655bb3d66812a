"""The pipeline process: renders what a bridge publishes.

rendering.py   one frame, from a state to what is perceived
offline.py     every frame of a recording
live.py        frames by the clock, for as long as it is asked to
requests.py    what a live worker is asked, from a thread of its own
take.py        what it keeps while a take runs
checkpoint.py  what a worker that is started anew goes on from
publish.py     its socket: each thing is made while somebody wants it
engine.py      from what was perceived to what a game engine needs
again.py       a folder's frames once more
"""
