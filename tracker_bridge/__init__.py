"""The eye side: from an eye tracker to an `EyeState` that a renderer can trust.

samples.py         the records that flow: PupilSample, GazeSample, EyeState
events.py          what happened: blinks, saccades, a tracker lost or back, a clock that was set
source.py          what every source offers
sources/           where samples come from; usb_twin/ and capture_twin/ imitate trackers for tests and demonstrations
clock.py           how a source's clock stands to the bridge's

chain.py           samples to states and events: pure, in order
dropout.py         which diameters to trust, and what to show meanwhile; its parts:
                   trust.py (the gate), lids.py,
                   dropout_interval.py (from the first mistrusted sample to the return),
                   extrapolation.py (where a pupil was going)
fixed_lag.py       the same states 50 ms later, and better
microsaccades.py   saccades as they happen, of both eyes; its parts: saccade_of_one_eye.py, saccade_velocity.py
oracles/           what they are judged by: the Microsaccade Toolbox's method, over a whole recording

calibration.py     the black and white screens, step by step; calibration_quality.py judges what was measured
pupil_map.py       its result: what diameters mean

bridge.py          the loop that publishes a source
publisher.py       the sockets that states and events leave by
replay.py          events kept for who missed them
access.py          who may hear the bridge
wire.py            the msgpack form of it all; the one module that the light side imports
"""
