"""`entoptic render`: one HDR picture as a person perceives it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from entoptic.services.command_line import options
from entoptic.services.config import SettingsConfig, StillConfig
from entoptic.services.process import prepare_jax
from entoptic.services.terminal import console


@options
def render(
    image: Annotated[str, typer.Argument(help="HDR picture or panorama: .hdr or .exr.")],
    still: StillConfig,
    settings: SettingsConfig,
    output: Annotated[Path, typer.Option("--output", "-o", help="PNG file to write.")] = Path("perceived.png"),
) -> None:
    """Perceive one HDR image."""
    prepare_jax()
    from entoptic.services import render as renders
    from entoptic.services import settings as all_settings
    from entoptic.services.explain.subject import from_image

    renders.run(from_image(image, still, all_settings.of(settings)), output, console)
