"""Every way to run every effect, and the truth that each stands beside.

stage.py           one eye before one scene: what each effect starts from
way.py             one way to run one effect; measuring them
before_display.py  adaptation, glare, acuity, rod noise, whose images are in cd/m² of the scene
on_display.py      tone mapping, night colour, afterimages and encoding, whose images are in cd/m² of the display
"""

from entoptic.pipeline.cost.ways.before_display import acuity_ways, adaptation_ways, glare_ways, rod_noise_ways
from entoptic.pipeline.cost.ways.on_display import afterimage_ways, encode_ways, night_colour_ways, tone_ways
from entoptic.pipeline.cost.ways.stage import Stage
from entoptic.pipeline.cost.ways.way import Row, Way, measure_ways

__all__ = ["EFFECTS", "Row", "Stage", "Way", "measure_ways"]

EFFECTS = {
    "adaptation": adaptation_ways,
    "glare": glare_ways,
    "acuity": acuity_ways,
    "rod_noise": rod_noise_ways,
    "tone": tone_ways,
    "night_colour": night_colour_ways,
    "afterimage": afterimage_ways,
    "encode": encode_ways,
}
"""What gives the ways of each effect, in the order in which effects run."""
