"""The eye side: from an eye tracker to an `EyeState` that a renderer can trust.

samples.py   the records that flow: PupilSample, GazeSample, EyeState, events
wire.py      their msgpack form; the one module that the light side imports
sources/     where samples come from, one file a source, each with a simulated twin
dropout.py   which diameters to trust, and what to show meanwhile
bridge.py    samples to states, and the loop that publishes them
"""
