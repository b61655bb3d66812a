"""Sessions that run by the clock: what their processes say to each other, and what keeps them running.

choice.py     what a live session is made of: eyes, scene, view, settings; checked.py opens all of it once
addresses.py  where its processes are to be reached
requests.py   what each of them may be asked to do
messages.py   what a worker publishes: pictures, plans, and what a game engine needs
door.py       who may come in where there are keys

host.py       starts, watches and ends the processes, one session at a time
live_session.py  one session: bridge, worker, take
supervised.py, supervision.py, children.py  one process: started, watched, started anew
arguments.py  what the processes are started with; web.py: the console's server
takes.py, kept_take.py  the folder of a take, from its first file to its report
watching.py, asking.py  what the processes say of themselves
attended.py, on_terminal.py  a session that a person started on the command line
journal.py    all processes' log lines in one place
registry.py   which hosts run on this machine; status.py says it to a person
"""
