"""What an eye does to a frame, one package or file an effect, in the order in which they run.

adaptation/     the luminance the eye is adapted to, and the exposure that follows from it
glare/          light that the eye scatters away from where it belongs
acuity/         detail that an eye loses in the dark
rod_noise.py    noise near the absolute threshold
tone/           from scene to display luminance
night_colour/   colour where rods see
afterimage/     what a bright light leaves in the eye
encode.py       what a display is sent
settings.py     all of their settings together

Each says in `bounds.py` (glare in `changes.py`) how much leaving it out may change, and what becomes of a change that
came before it: two pure functions over a frame's tiles (pipeline/ranges.py) that planning is made of.
"""
