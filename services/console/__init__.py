"""The console: one web page to start, watch, calibrate and record a session.

protocol.py   every message from the server to a page
requests.py   what a page may ask for
server.py     routes, the WebSocket, start and end; process.py: the process around it
access.py     what the command line says of where a session is and of who may see it
security.py   who may come in: host names, origins, the token, what browsers are told
viewers.py    the pages that watch, and what each of them is sent
live.py       what is known of the session that runs, and the settings in force
listening.py  a thread that reads sockets; the next two are such threads
feed.py       states, events and frames' figures from bridge and worker
pictures.py   frames' pictures from the worker
figures.py    what the last seconds of states and frames come to
jpeg.py       how a picture becomes a JPEG
problems.py   what is wrong, and what to do: what the processes say, and what only the console sees
actions.py    what a page asks for, done
fields.py     settings as sliders, switches and choices
listing.py    observers, scenes, eye data and sessions that are there
page/         the page itself
"""
