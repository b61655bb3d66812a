"""What a bright light leaves in the eye: its cones are bleached where it fell, and see less, or light of their own.

settings.py  whether, and how fine
retina.py    what is bleached: the record, and its step from frame to frame
geometry.py  where a direction falls on the retina of an eye that looks elsewhere
seen.py      what a bleached retina makes of what is seen, and what it shows by itself
show.py      a displayed frame with its afterimages
bounds.py    how much they may change

The light that bleaches is the scene's, in cd/m²; what is seen of it is laid over the displayed frame. So an afterimage
moves with the measured gaze, lasts through a blink, and shows on whatever is looked at next.
"""

from entoptic.pipeline.effects.afterimage.bounds import passed_on, skipped
from entoptic.pipeline.effects.afterimage.retina import HALF_TD, TAU_S, Retina, rested, step
from entoptic.pipeline.effects.afterimage.settings import Afterimage
from entoptic.pipeline.effects.afterimage.show import show

__all__ = ["HALF_TD", "TAU_S", "Afterimage", "Retina", "passed_on", "rested", "show", "skipped", "step"]
