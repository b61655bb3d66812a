"""The processes, and what a person types to start them.

What knows more stands higher, and nothing looks up; pyproject.toml has the layers as a contract. From the top:

cli.py, commands/   the program, and one file a command; child.py: a process that another one of ours starts
live/               keeps a session's processes running, and records
console/            the web page; session/: recorded eyes and their frames, in one process
bridge/, worker/    the eyes' process and the frames' process
recording.py        a recording's folder, from its first file to its report
calibration/        pupils viewing white and black screens; capture/: the stand-in for Pupil Capture;
                    cost/, detect.py, render.py: what other commands do
report/, psf/, explain/, event_scores.py   pages and plots; reader.py: what a worker hears of a bridge
results/            what a session leaves in its folder
ipc/                what the processes say to each other; event_feed.py, rendering.py, web_server.py
session_config.py   the record that describes a session; config.py: its parts
eye_data.py, settings.py   what a session opens; simulated_light.py
command_line.py, records.py   command lines and forms from records
process.py, keys.py, terminal.py   what all processes do alike
"""
