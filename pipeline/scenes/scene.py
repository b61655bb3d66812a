"""What every scene is: a name, notes for the person, a view, and a frame for a time and a head.

The world's axes are x to the right, y up and z straight ahead; azimuth 0°, elevation 0° is +z. All of a scene is a
function of its arguments: frames may be asked for in any order.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from entoptic.pipeline.effects.effect import Cost
from entoptic.pipeline.frame import Frame, FrameError, View
from entoptic.tracker_bridge.wire import Eye

DEFAULT_WIDTH_PX, DEFAULT_HEIGHT_PX = 720, 800
"""A view for scenes without pixels of their own: half the head-mounted display of LUI 5.3.2 (1440×1600 an eye), since
a quarter of its pixels is what two processor cores can follow (engineering choice)."""


class Head(NamedTuple):
    """Which way the head points, in degrees; it turns about the point between the eyes."""

    yaw_deg: float = 0.0
    """To the right, about the world's vertical."""
    pitch_deg: float = 0.0
    """Up, about the axis through both ears."""
    roll_deg: float = 0.0
    """Clockwise as the person sees it, about the direction of the nose: the right ear goes down."""


class Scene(Protocol):
    """Where frames come from."""

    @property
    def name(self) -> str:
        """For a person: "night street"."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or repaired on opening, a sentence each: scale, bad pixels, panorama or picture."""
        ...

    @property
    def cost(self) -> Cost:
        """Of making a frame, on two cores at 2.5 GHz, as those of effects: budgets count it."""
        ...

    def view_for(self, width_px: int | None, height_px: int | None, fov_deg: float) -> View:
        """A view of this scene; None leaves that side to the scene. Raises FrameError if it cannot be seen so."""
        ...

    def frame(self, t_s: float, view: View, head: Head, eyes: tuple[Eye, ...]) -> Frame:
        """What stands before `eyes`, in their order, at time `t_s`. Raises FrameError for a view it cannot serve."""
        ...


def headset_view(width_px: int | None, height_px: int | None, fov_deg: float) -> View:
    """A view of a scene that has no pixels of its own; one given side keeps the aspect of the default view."""
    if width_px is None and height_px is None:
        return View(DEFAULT_WIDTH_PX, DEFAULT_HEIGHT_PX, fov_deg)
    if width_px is None:
        assert height_px is not None
        return View(max(1, round(height_px * DEFAULT_WIDTH_PX / DEFAULT_HEIGHT_PX)), height_px, fov_deg)
    if height_px is None:
        return View(width_px, max(1, round(width_px * DEFAULT_HEIGHT_PX / DEFAULT_WIDTH_PX)), fov_deg)
    return View(width_px, height_px, fov_deg)


def count_eyes(eyes: tuple[Eye, ...]) -> int:
    """How many images a frame for `eyes` has. Raises FrameError unless it is one eye or each eye once."""
    if len(eyes) not in (1, 2) or len(set(eyes)) != len(eyes):
        raise FrameError(
            f"a frame for {len(eyes)} eyes {[eye.name for eye in eyes]}: ask for one eye, or for both once"
        )
    return len(eyes)


def rotation(head: Head) -> np.ndarray:
    """The head's axes in the world: a float32 3×3 matrix whose columns are its right, up and forward.

    Yaw comes first, then pitch, then roll.
    """
    yaw, pitch, roll = (math.radians(angle) for angle in head)
    right = np.array([math.cos(yaw), 0.0, -math.sin(yaw)])
    up = np.array([-math.sin(yaw) * math.sin(pitch), math.cos(pitch), -math.cos(yaw) * math.sin(pitch)])
    forward = np.array([math.sin(yaw) * math.cos(pitch), math.sin(pitch), math.cos(yaw) * math.cos(pitch)])
    tilted_right = math.cos(roll) * right - math.sin(roll) * up
    tilted_up = math.cos(roll) * up + math.sin(roll) * right
    return np.stack([tilted_right, tilted_up, forward], axis=1).astype(np.float32)


@functools.partial(jax.jit, static_argnames="view")
def rays(view: View, axes: Float[Array, "3 3"]) -> Float[Array, "3 y x"]:
    """The direction that each pixel's centre looks in, in the world, for `axes` from `rotation`.

    Not normalised: the component along the head's forward axis is 1, so that a ray's parameter is depth.
    """
    right = (jnp.arange(view.width_px, dtype=jnp.float32) + (0.5 - view.width_px / 2)) / view.focal_px
    up = ((view.height_px / 2 - 0.5) - jnp.arange(view.height_px, dtype=jnp.float32)) / view.focal_px
    columns = axes[:, 0, None] * right + axes[:, 2, None]
    return columns[:, None, :] + (axes[:, 1, None] * up)[:, :, None]
