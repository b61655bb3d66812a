"""What accuracy costs in time: tables and plots.

glare.py, glare_plots.py            glare in depth
everything.py, everything_plots.py  every effect, and which setting to take for a frame rate
"""
