"""How each effect is simulated where it runs."""

from __future__ import annotations

import msgspec

from entoptic.pipeline.effects.acuity import Acuity
from entoptic.pipeline.effects.adaptation import Adaptation
from entoptic.pipeline.effects.afterimage import Afterimage
from entoptic.pipeline.effects.glare import Glare
from entoptic.pipeline.effects.night_colour import NightColour
from entoptic.pipeline.effects.rod_noise import RodNoise
from entoptic.pipeline.effects.tone import Tone


class Effects(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One table an effect; what is left out has its default."""

    adaptation: Adaptation = Adaptation()
    glare: Glare = Glare()
    acuity: Acuity = Acuity()
    rod_noise: RodNoise = RodNoise()
    tone: Tone = Tone()
    night_colour: NightColour = NightColour()
    afterimage: Afterimage = Afterimage()
