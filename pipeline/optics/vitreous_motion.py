"""The vitreous as one rigid body that lags behind the turning eye and comes back to it (RIT 3.4).

Theory of operation: its rotation against the eye, about two axes, is a damped oscillator each. A saccade is over within
a tenth of the time that the way back takes, so it counts as a step: the eye has turned, the vitreous has not yet come
along. All is linear; so the step of a saccade that ended some time ago is added as it has decayed since, and neither
the frame rate nor the time that it takes to tell a saccade changes where the vitreous is.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from entoptic.pipeline.optics import OpticsError
from entoptic.pipeline.optics.damped import free_motion

LAG_SHARE = 0.5
"""How much of an eye's turn the vitreous lags behind at its end. Engineering choice: the gel is held by the wall that
turns, which would make it 0, and its middle stays behind by inertia, which would make it 1."""
OMEGA_RAD_S = 2 * math.pi
"""Undamped frequency, 1 Hz. Engineering choice: with DAMPING_RATIO a lag falls to a tenth in 1.1 s and to a hundredth
in 2.0 s. The vitreous comes to rest within seconds (RIT 3.4, after Zimmerman 1980)."""
DAMPING_RATIO = 1.5
"""Over 1, since the vitreous in a living eye was found overdamped (Zimmerman 1980, Biophys. J. 29, 539): it comes back
and does not swing past. How far over is an engineering choice; see OMEGA_RAD_S."""
MAX_KICK_DEG = 180.0

_Pair = Float[np.ndarray, "2"]
Axes = tuple[float, float]
"""About the axis that makes for a turn to the right, and about the one for a turn upwards."""


@dataclasses.dataclass(frozen=True)
class SaccadeImpulse:
    """A turn of the eye, by a saccade or microsaccade. Raises OpticsError for what no eye does."""

    right_deg: float
    """How far the eye turned to the right, −180…180."""
    up_deg: float
    """How far it turned upwards, −180…180."""
    ago_s: float = 0.0
    """How long before the end of the step it was over, ≥ 0."""

    def __post_init__(self) -> None:
        # Written so that NaN fails too.
        if not (abs(self.right_deg) <= MAX_KICK_DEG and abs(self.up_deg) <= MAX_KICK_DEG):
            raise OpticsError(
                f"an eye that turns by ({self.right_deg}, {self.up_deg})°: give angles from −180 to 180, or leave the "
                "kick out"
            )
        if not 0.0 <= self.ago_s < math.inf:
            raise OpticsError(f"a kick {self.ago_s} s ago: give seconds from 0 up")


@dataclasses.dataclass(frozen=True)
class VitreousState:
    """Where the vitreous is, against the eye."""

    deg: Axes = (0.0, 0.0)
    """Its rotation to the right and upwards."""
    deg_s: Axes = (0.0, 0.0)


def step(state: VitreousState, dt_s: float, impulses: Sequence[SaccadeImpulse]) -> VitreousState:
    """The vitreous `dt_s` ≥ 0 later, with the impulses of this step. Exact for any time."""
    deg, deg_s = _freely(np.array(state.deg), np.array(state.deg_s), dt_s)
    for kick in impulses:
        behind = _freely(-LAG_SHARE * np.array((kick.right_deg, kick.up_deg)), np.zeros(2), kick.ago_s)
        deg, deg_s = deg + behind[0], deg_s + behind[1]
    return VitreousState((float(deg[0]), float(deg[1])), (float(deg_s[0]), float(deg_s[1])))


def _freely(deg: _Pair, deg_s: _Pair, dt_s: float) -> tuple[_Pair, _Pair]:
    return free_motion(deg, deg_s, OMEGA_RAD_S, DAMPING_RATIO, dt_s)
