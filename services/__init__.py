"""The processes, and what a person types to start them.

cli.py         the program: its commands and its errors
commands/      one file a command: its options
options.py     the options that several commands share
settings.py    what a settings file may hold
process.py     what all processes do alike: logs, signals, ending with their parent
eye_data.py    opens the eye data that a command names

bridge.py      the bridge process: publishes a source
control.py     what a running bridge may be asked to have its tracker do
keys.py        key files for a bridge that is heard beyond this machine
capture/       the stand-in for Pupil Capture
calibrate.py   pupils before white and black screens; calibration_display.py asks for them, calibration_page/ shows
               them in a browser, calibration_result.py judges and writes, calibration_plot.py draws
detect.py      saccades and blinks of a recording; event_scores.py compares them with labels

render.py      one HDR picture, perceived
psf/           one person's eye as light: pictures, profiles, sheets, a film
cost.py        what accuracy costs in time: tables; cost_plots.py draws them

worker.py      the pipeline process: renders what the bridge publishes
reader.py      its ear: states; event_feed.py: events, the lost ones too
results.py     what it leaves behind
results_folder.py  folders that are written whole or not at all
session.py     starts both for a recording, shows progress, gathers the results; session_again.py does it once more
live/          sessions by the clock: the host of all processes, and what they say to each other
status.py      how running sessions are
report.py      what a person looks at afterwards
"""
