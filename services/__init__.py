"""The processes, and what a person types to start them.

cli.py         the program: its commands and its errors
commands/      one file a command: its options
options.py     the options that several commands share
settings.py    what a settings file may hold
process.py     what all processes do alike: logs, signals, ending with their parent
eye_data.py    opens the eye data that a command names
simulated_light.py  the light that simulated eyes answer to
keys.py        key files for processes that are heard beyond this machine
control.py     how a running process is asked for something
web_server.py  what serves pages

bridge/        the eyes' process
worker/        the frames' process; reader.py, event_feed.py: its ear, and any other reader's
session/       both, by recorded time
live/          both, by the clock: what they say to each other, and the host that keeps them running
console/       the web page to run a live session from
results/       what a session leaves; report/: what a person looks at afterwards

capture/       the stand-in for Pupil Capture
calibration/   pupils before white and black screens
detect.py      saccades and blinks of a recording; event_scores.py compares them with labels
render.py      one HDR picture, perceived
explain/       why a picture looks as it does
psf/           one person's eye as light: pictures, profiles, sheets, a film
cost/          what accuracy costs in time
"""
