"""The bridge process: publishes a source, and answers what it is asked.

process.py     the process, from a source to its end
handler.py     handles a live bridge's requests
tracker_tasks.py  what a tracker can be asked to do by itself
recording.py   what a live bridge records; tables.py: states.csv and events.csv
scene_light.py the scene's light, for simulated eyes
"""
