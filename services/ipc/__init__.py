"""What the processes say to each other, over ZeroMQ; nothing here knows any of them.

addresses.py      where the processes of a live session are to be reached
requests.py       what each of them may be asked to do
client.py         asks one of them
handler.py        answers, in the process that is asked
status.py         how each of them is, and what is wrong with it; status_poll.py asks for it again and again
messages.py       what a worker publishes: pictures, plans, and what a game engine needs
shown_reader.py   the newest frame's figures, for somebody who looks now and then
"""
