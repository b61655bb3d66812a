"""A part that serves for one frame: what an eye's motion adds to eyes at rest."""

from __future__ import annotations

from entoptic.pipeline.effects.glare.kernel import Part


class Passing(Part):
    """Such a part. It is a few per cent of the light: its windows are made in a fraction of the time, and not kept."""
