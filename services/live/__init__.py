"""Sessions that run by the clock: what keeps their processes running, and what is recorded of them.

host.py       starts, watches and ends the processes, one session at a time
live_session.py  one session: bridge, worker, recording
supervised.py, supervision.py, children.py  one process: started, watched, started again; web.py: the console's server
recorder.py   tells the processes of a recording
foreground.py, on_terminal.py  a session that a person started on the command line
journal.py    all processes' log lines in one place
registry.py   which hosts run on this machine; status.py: how they are, for a person
"""
