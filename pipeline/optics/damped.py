"""The free motion of a damped oscillator, x'' + 2ζω x' + ω² x = 0, in closed form: exact and stable for any time."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float

Values = Float[np.ndarray, "..."]


def free_motion(
    position: Values, velocity: Values, omega_rad_s: Values | float, damping_ratio: float, dt_s: float
) -> tuple[Values, Values]:
    """Position and velocity after `dt_s` ≥ 0 without a force, for oscillators of ω > 0 and one damping ratio ζ ≥ 0.

    Under-, critically and overdamped alike. x(t) = x₀(c + ζω s) + v₀ s, where c and s are e^(−ζωt) times cos and
    sin/ω_d, times 1 and t, or times cosh and sinh/ω_d; each is written so that it loses no digits as ζ nears 1, and the
    last ones so that they do not overflow.
    """
    omega = np.asarray(omega_rad_s, np.float64)
    gamma = damping_ratio * omega
    split = omega * math.sqrt(abs((1.0 - damping_ratio) * (1.0 + damping_ratio)))
    if damping_ratio > 1.0:
        # The slower of two decays, as a quotient: the difference γ − split would lose its digits where ζ is large.
        decay = np.exp(-(omega**2) / (gamma + split) * dt_s)
        c = decay * (1.0 + np.exp(-2.0 * split * dt_s)) / 2.0
        s = decay * -np.expm1(-2.0 * split * dt_s) / (2.0 * split)
    elif damping_ratio < 1.0:
        decay = np.exp(-gamma * dt_s)
        c, s = decay * np.cos(split * dt_s), decay * np.sin(split * dt_s) / split
    else:
        c = np.exp(-gamma * dt_s)
        s = c * dt_s
    return position * (c + gamma * s) + velocity * s, velocity * (c - gamma * s) - omega**2 * position * s
