"""Sessions that run by the clock: what their processes say to each other, and what keeps them running.

choice.py     what a live session is made of: eyes, scene, view, settings
addresses.py  where its processes are to be reached
requests.py   what each of them may be asked to do
messages.py   what a worker publishes: pictures, plans, and what a game engine needs
publish.py    its socket: each thing is made while somebody wants it (door.py: who may come in)
engine.py     from what was perceived to what a game engine needs
bridge_desk.py  who answers a live bridge's requests; bridge_take.py, tables.py: what it keeps of a take
scene_light.py  the scene's light, for simulated eyes
pupil_calibration.py  a calibration in the bridge, between its items; pupil_outcome.py works it out and draws it

host.py       starts, watches and ends the processes; answers the console. attended.py: from a terminal (on_terminal.py)
live_session.py  bridge and worker of one session; kept_take.py tells them of a take, takes.py makes its folder whole
supervised.py one process through all its lives; children.py one life; supervision.py when another begins
checked.py    all that a choice names, opened before anything starts; arguments.py: the command lines made of it
session_file.py  session.json and the copies of inputs
registry.py   which hosts run; journal.py: all processes' logs in one place
asking.py, watching.py  what others say, heard without waiting; web.py: the console's server as a child
"""
