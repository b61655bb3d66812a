"""The console: one web page to start, watch, calibrate and record a session.

protocol.py   every message from the server to a page
requests.py   what a page may ask for
server.py     routes, the WebSocket, start and end
security.py   who may come in: host names, origins, the token, what browsers are told
viewers.py    the pages that watch, and what each of them is sent
feed.py       states, events and frames' figures from bridge and worker
pictures.py   frames' pictures from the worker, as JPEG
jpeg.py       how a picture becomes one
status.py     what the processes say of themselves
problems.py   what is wrong, and what to do
actions.py    how that is done
fields.py     settings as sliders, switches and choices
listing.py    observers, scenes, sources and sessions that are there
page/         the page itself
"""
