"""Measured figures, in words."""

from __future__ import annotations

from collections.abc import Iterable

from entoptic.pipeline.measure import Measurement


def number(value: float) -> str:
    """Two digits, or whole from 10 on."""
    return f"{value:.0f}" if 10 <= value < 1e4 else f"{value:.2g}"


def of_each_eye(values: Iterable[float]) -> str:
    """A figure of each eye, equal ones once."""
    return " and ".join(f"{value:.3g}" for value in dict.fromkeys(values))


def darkness(measured: Measurement, below_cd_m2: float) -> str:
    """How dark an image is."""
    share = measured.share_below(below_cd_m2)
    return f"darkest pixel {number(measured.min_cd_m2)} cd/m², {share:.0%} of the frame below {below_cd_m2:g} cd/m²"
