"""What a game engine needs to apply the effects itself: from what was perceived to EngineFrame and EngineKernel.

Theory of operation: all that an eye does to a frame is few numbers and one small picture, the glare's kernel. A kernel
is a weighted sum of prepared ones whose weights follow the pupil; it is summed here, and once more over the colours of
a white light, since an engine has one kernel a channel and not one from each channel to each other. It counts as a new
one when its parts are others or a weight has changed by LEAST_STEP, and never sooner than 1/KERNELS_PER_S after the
last. Half floats keep 11 digits down to 6e-5 and fewer below, while a kernel falls by five decades to its edge: so it
is scaled, and its middle, which is nearly 1, has a field of its own. What half floats lose of its sum the middle gets.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from entoptic.pipeline import Display, Step, View
from entoptic.pipeline.display_light import black_share, seen_peak_cd_m2
from entoptic.pipeline.effects import Effects
from entoptic.pipeline.effects.acuity import AcuityMethod, larson
from entoptic.pipeline.effects.acuity.fit import LIMIT_CD_M2
from entoptic.pipeline.effects.adaptation import exposure
from entoptic.pipeline.effects.glare import GLARE, Mixture
from entoptic.pipeline.effects.glare.kernel import Part, Veil, amounts
from entoptic.pipeline.effects.night_colour import NightColour, NightMethod, tints
from entoptic.pipeline.effects.night_colour.share import adapted_share
from entoptic.pipeline.effects.tone import Operator, full_cd_m2
from entoptic.pipeline.effects.tone.show import coefficients
from entoptic.pipeline.optics import radial
from entoptic.pipeline.optics.whole import VEIL_DEG, kernel_radius_px
from entoptic.pipeline.primaries import SUM_WEIGHTS
from entoptic.services.ipc.messages import EngineEye, EngineFrame, EngineKernel
from entoptic.services.rendering import Rendered
from entoptic.tracker_bridge.wire import Eye, Phase

LEAST_STEP = 1 / 32
"""Of a weight. Engineering choice: 0.008 mm of a pupil, far below what a tracker resolves."""
KERNELS_PER_S = 10.0
"""Of each eye. Engineering choice: a pupil takes 0.2 s and more to get anywhere."""
LARGEST = 1024.0
"""Up to which half floats are used: five decades below it they still have all their digits, and sums of 64 such values
stay in their range."""
VEIL_ANGLES_DEG = tuple(
    float(deg) for deg in (*np.linspace(*VEIL_DEG, 9)[:-1], *np.geomspace(VEIL_DEG[1], radial.EDGE_DEG, 25))
)
"""Straight lines between them are within 1 % of a veil."""


def engine_frame(
    rendered: Rendered, eyes: Sequence[Eye], effects: Effects, display: Display, kernels: Sequence[int], t_ns: int
) -> EngineFrame:
    """What to do to a frame; `kernels` are the numbers of the eyes' kernels, `t_ns` is when it was begun."""
    return EngineFrame(
        frame=rendered.frame_number,
        t_ns=t_ns,
        eyes=tuple(
            _eye(rendered, k, eye, effects, display, number)
            for k, (eye, number) in enumerate(zip(eyes, kernels, strict=True))
        ),
        display_peak_cd_m2=seen_peak_cd_m2(display),
        display_black_share=black_share(display),
    )


def _eye(rendered: Rendered, k: int, eye: Eye, effects: Effects, display: Display, number: int) -> EngineEye:
    perceived, pose, view = rendered.perceived, rendered.poses[k], rendered.frame.view
    plan, adapted = perceived.plan, perceived.state.adapted[k]
    adapted_cd_m2, target_cd_m2 = adapted.luminance_cd_m2, adapted.tone_target_cd_m2(effects.adaptation)
    numbers = coefficients(adapted_cd_m2, target_cd_m2, effects.tone, display)
    glare, acuity, night = plan[GLARE.name], plan["acuity"], plan["night_colour"]
    phase = None if rendered.state is None else rendered.state.of(eye).phase
    method = effects.night_colour.method
    return EngineEye(
        eye=eye.name.lower(),
        gaze_deg=(pose.azimuth_deg, pose.elevation_deg),
        openness=pose.openness,
        blink=phase in (Phase.CLOSING, Phase.BLINK, Phase.OPENING),
        pupil_diameter_mm=perceived.pupil_diameter_mm[k],
        adapted_cd_m2=adapted_cd_m2,
        glare=glare.level,
        kernel=number if glare.runs else 0,
        glare_weight=_weight(glare),
        glare_ceiling_cd_m2=(
            full_cd_m2(adapted_cd_m2, target_cd_m2, effects.tone, display) if effects.glare.above_display else None
        ),
        acuity=acuity.level,
        acuity_weight=_weight(acuity),
        acuity_sigma_px=_sigma_px(adapted_cd_m2, view, effects) if acuity.runs else 0.0,
        tone=effects.tone.operator.value,
        hue=effects.tone.hue.value,
        exposure=numbers[0] if effects.tone.operator in _EXPOSED else exposure(adapted_cd_m2),
        tone_numbers=tuple(map(float, numbers)),
        night_colour=method.value,
        tint_rgb=_triple(tints.tint(method, adapted_cd_m2)),
        tint_share=_weight(night) * _share(adapted_cd_m2, effects.night_colour),
        rod_weights=tints.weights(method),
    )


_EXPOSED = (Operator.ACES, Operator.REINHARD, Operator.WARD)
"""Operators whose first number is what luminance is multiplied by."""


def _weight(step: Step) -> float:
    """How much of an effect is in the picture, whatever its level."""
    return sum(weight for level, weight in step.weights.items() if level not in _NOTHING) if step.runs else 0.0


_NOTHING = ("skipped", "off")


def _sigma_px(adapted_cd_m2: float, view: View, effects: Effects) -> float:
    if effects.acuity.method is AcuityMethod.FIT:
        return max(1 - adapted_cd_m2 / LIMIT_CD_M2, 0.0)
    return math.sqrt(float(larson.variance_px2(adapted_cd_m2, view.ppd_centre, effects.acuity.display_limit)))


def _share(adapted_cd_m2: float, settings: NightColour) -> float:
    """The rods' share of a white pixel's light, in an eye so adapted."""
    share = float(adapted_share(np.asarray(adapted_cd_m2), settings))
    if settings.method is not NightMethod.KRI_XY:
        return share
    blue = share * sum(SUM_WEIGHTS)
    return blue / ((1 - share) / tints.BLUE_XY[1] + blue)


def _triple(values: NDArray[np.float64]) -> tuple[float, float, float]:
    red, green, blue = map(float, values)
    return red, green, blue


@dataclasses.dataclass(frozen=True)
class Held:
    """The kernel that an eye has for other programs."""

    number: int
    mixture: Mixture
    t_ns: int


class KernelNumbers:
    """Numbers of kernels: an eye gets another when its kernel has changed, but not too often."""

    def __init__(self, last: int) -> None:
        """`last`: no number up to this one is given."""
        self._held: dict[Eye, Held] = {}
        self._last = last

    def number(self, eye: Eye, mixture: Mixture, t_ns: int) -> int:
        """The number of an eye's kernel at a time."""
        before = self._held.get(eye)
        if before is not None and (
            t_ns - before.t_ns < 1e9 / KERNELS_PER_S or not _differs(before.mixture, mixture, LEAST_STEP)
        ):
            return before.number
        self._last += 1
        self._held[eye] = Held(self._last, mixture, t_ns)
        return self._last

    @property
    def held(self) -> dict[Eye, Held]:
        """What the numbers stand for now."""
        return dict(self._held)


def _differs(one: Mixture, other: Mixture, least: float) -> bool:
    weights = dict(one)
    for part, weight in other:
        weights[part] = weights.get(part, 0.0) - weight
    return any(abs(change) >= least for change in weights.values())


def engine_kernel(held: Held, eye: Eye, pixels_per_deg: float) -> EngineKernel:
    """A kernel as an engine takes it."""
    mixture = held.mixture
    white = np.sum([weight * _of_white(part, pixels_per_deg) for part, weight in mixture], axis=0)
    middle = white.shape[0] // 2
    white[middle, middle] = 0
    largest = float(np.abs(white).max())
    scale = 2.0 ** math.ceil(math.log2(largest / LARGEST)) if largest > 0 else 1.0
    halves = (white / scale).astype("<f2")
    shares = {veil: weight * _veil_volume(veil) for veil, weight in amounts(mixture).items()}
    veil_share = sum(shares.values())
    stays = 1 - veil_share - halves.astype(np.float64).sum(axis=(0, 1)) * scale
    veil = np.sum([share * _unit_veil(function) for function, share in shares.items()], axis=0) if shares else ()
    return EngineKernel(
        number=held.number,
        eye=eye.name.lower(),
        side=len(white),
        pixels_per_deg=pixels_per_deg,
        rgb=halves.tobytes(),
        scale=scale,
        stays_rgb=_triple(stays),
        veil_share=veil_share,
        veil_deg=VEIL_ANGLES_DEG if shares else (),
        veil_per_sr=tuple(map(float, veil)),
    )


@functools.lru_cache(maxsize=4)
def _of_white(part: Part, pixels_per_deg: float) -> NDArray[np.float64]:
    """What a pixel of white light gives to those around it: (row, column, red green blue)."""
    to_channels = part.cells(pixels_per_deg, kernel_radius_px(pixels_per_deg), 1.0).sum(axis=1)
    return np.ascontiguousarray(np.broadcast_to(to_channels, (3, *to_channels.shape[1:])).transpose(1, 2, 0))


@functools.lru_cache(maxsize=16)
def _veil_volume(veil: Veil) -> float:
    return radial.hemisphere_volume(lambda deg: veil.density(deg, 1.0))


@functools.lru_cache(maxsize=16)
def _unit_veil(veil: Veil) -> NDArray[np.float64]:
    """A veil that takes all light, at VEIL_ANGLES_DEG."""
    return np.asarray(veil.density(np.array(VEIL_ANGLES_DEG), 1.0) / _veil_volume(veil))
