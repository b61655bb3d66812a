"""What an eye does to a frame: one module or package an effect, one line in EFFECTS, in the order in which they run.

effect.py       what an effect is
adaptation/     the luminance the eye is adapted to, and the exposure that follows from it
glare/          light that the eye scatters away from where it belongs
acuity/         detail that an eye loses in the dark
rod_noise.py    noise near the absolute threshold
tone/           from scene to display luminance
night_colour/   colour where rods see
afterimage/     what a bright light leaves in the eye
encode.py       what a display is sent

Renderer, planner, cost tables, settings, command line, console, documents and property tests loop over EFFECTS and name
no effect.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import msgspec

from entoptic.pipeline.effects.effect import Effect

EFFECTS: tuple[Effect[Any, Any], ...] = tuple(
    getattr(importlib.import_module(f"{__name__}.{name}"), name.upper())
    for name in (
        "adaptation",
        "glare",
        "acuity",
        "rod_noise",
        "tone",
        "night_colour",
        "afterimage",
    )
)
"""In the order in which they run: each the object in capitals of the module or package of its name."""

OPTIONAL = tuple(effect.name for effect in EFFECTS if effect.optional)
"""The effects that a picture can do without."""

if TYPE_CHECKING:

    class Effects(msgspec.Struct, frozen=True):
        """How each effect is simulated where it runs: one table an effect; what is left out has its default."""

        def __init__(self, **tables: msgspec.Struct) -> None: ...

        def __getattr__(self, name: str) -> Any: ...

else:
    Effects = msgspec.defstruct(
        "Effects",
        [(effect.name, effect.Settings, effect.Settings()) for effect in EFFECTS],
        namespace={"__doc__": "How each effect is simulated where it runs: one table an effect."},
        module=__name__,
        frozen=True,
        forbid_unknown_fields=True,
    )
