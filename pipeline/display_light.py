"""What a person sees of a display: its light, what the screen reflects, and the luminance they adapt to before it."""

from __future__ import annotations

from entoptic.pipeline.frame import Display, FrameError

REFLECTANCE = 0.01
"""Share of the light falling on a screen that it scatters back: 1 % for an LCD (Mantiuk 2008, display model)."""


def reflected_cd_m2(display: Display) -> float:
    """What the screen reflects: a surround of even luminance L lights it with π·L lx, so it returns its share of L."""
    return REFLECTANCE * display.surround_cd_m2


def seen_peak_cd_m2(display: Display) -> float:
    """Full white with the reflected light: the 1 of a shown frame."""
    return display.peak_cd_m2 + reflected_cd_m2(display)


def black_share(display: Display) -> float:
    """Full black with the reflected light, as a share of white with it."""
    if display.black_cd_m2 >= display.peak_cd_m2:
        raise FrameError(
            f"a display with black at {display.black_cd_m2:g} and its peak at {display.peak_cd_m2:g} cd/m²: "
            "black must be darker"
        )
    return (display.black_cd_m2 + reflected_cd_m2(display)) / seen_peak_cd_m2(display)


def viewer_cd_m2(display: Display) -> float:
    """L_da, what a person before the display is adapted to: half its peak (BAR 3.3, KRI 4.21), or a brighter surround.

    Engineering choice: a surround darker than that, as in a headset, takes nothing from the display.
    """
    return max(seen_peak_cd_m2(display) / 2, display.surround_cd_m2)
