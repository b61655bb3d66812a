"""From scene luminance to the display's.

settings.py  which operator, and what becomes of colours beyond the display's
show.py      the one entry: a frame in cd/m² as the display shows it
filmic.py  reinhard.py  ward.py  durand.py  own_curve.py   the operators: what they make of an eye's adaptation, of a
             pixel, and of an interval
hue.py       colours beyond the display's
bounds.py    what tone mapping makes of a range of values and of a change
code_values.py  what that is in code values
"""

from entoptic.pipeline.effects.tone.bounds import passed_on, shown
from entoptic.pipeline.effects.tone.code_values import code_values
from entoptic.pipeline.effects.tone.filmic import (
    MIDDLE_GREY,
    REFERENCE_PEAK_CD_M2,
    aces,
    ceiling_cd_m2,
    display_scale,
)
from entoptic.pipeline.effects.tone.settings import Hue, Operator, Tone
from entoptic.pipeline.effects.tone.show import full_cd_m2, show

__all__ = [
    "MIDDLE_GREY",
    "REFERENCE_PEAK_CD_M2",
    "Hue",
    "Operator",
    "Tone",
    "aces",
    "ceiling_cd_m2",
    "code_values",
    "display_scale",
    "full_cd_m2",
    "passed_on",
    "show",
    "shown",
]
