"""The frames that settings are compared on."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping

import jax.numpy as jnp
import numpy as np

from entoptic.pipeline.cost import landscape, rooms
from entoptic.pipeline.cost.landscape import SUN_CD_M2, SUN_RADIUS_DEG
from entoptic.pipeline.effects import Effects, adaptation
from entoptic.pipeline.eye_context import EyeContext
from entoptic.pipeline.eye_pose import EyePose
from entoptic.pipeline.frame import Display, Frame, View
from entoptic.pipeline.measure import Measurement, measure
from entoptic.pipeline.observer import Observer
from entoptic.pipeline.optics.aperture import Pose
from entoptic.pipeline.scenes.night_street import NightStreet
from entoptic.pipeline.scenes.scene import Head
from entoptic.pipeline.viewing import view_frame
from entoptic.tracker_bridge.wire import Eye

STREET_S = 3.0
"""When in the street's course: a car comes with dipped headlights."""
SUN_DARK_CD_M2 = 1e-3
"""What the sun stands beside: a moonless night's ground."""
LAMPS_DARK_CD_M2 = 0.01
FINE = 16
"""Samples along a pixel of a computed disc."""
FOV_DEG = 40.0
"""Of the two frames of glare alone: at 512 pixels 12 pixels per degree, as a headset has in its middle."""


@dataclasses.dataclass(frozen=True, eq=False)
class CostScene:
    """A frame of one eye that looks straight ahead, fully adapted."""

    name: str
    frame: Frame

    @functools.cached_property
    def measured(self) -> Measurement:
        """What the frame contains."""
        return measure(self.frame)[0]

    @functools.cached_property
    def adapted_cd_m2(self) -> float:
        """The luminance that the eye is adapted to."""
        return adaptation.target_cd_m2(self.measured, 0.0, 0.0)

    @property
    def exposure(self) -> float:
        """1/(cd/m²): what that makes of the frame."""
        return adaptation.exposure(self.adapted_cd_m2)


def _street(view: View) -> Frame:
    return NightStreet().frame(STREET_S, view, Head(), (Eye.LEFT,))


SCENES: Mapping[str, Callable[[View], Frame]] = {
    "starlight": lambda view: landscape.landscape(view, landscape.STARLIGHT),
    "moonlight": lambda view: landscape.landscape(view, landscape.MOONLIGHT),
    "candle room": rooms.candle_room,
    "night street": _street,
    "dusk": lambda view: landscape.landscape(view, landscape.DUSK),
    "bright room": rooms.bright_room,
    "sunny landscape": lambda view: landscape.landscape(view, landscape.SUNNY),
    "sun disc": lambda view: landscape.landscape(view, landscape.SUN_DISC),
}
"""All effects are compared on these, dark to bright: one eye's frame at any size and field of view."""


def scene(name: str, width_px: int, height_px: int, fov_deg: float = 104.0) -> CostScene:
    """One of SCENES at a size."""
    return CostScene(name, SCENES[name](View(width_px, height_px, fov_deg)))


def night_street(shrink: int = 1) -> CostScene:
    """The embedded scene, 0.003 to 1.2e4 cd/m², over 104°."""
    view = View(720 // shrink, 800 // shrink)
    return CostScene("night street", _street(view))


def lamps_over_dark(shrink: int = 1) -> CostScene:
    """Twenty lamps of all colours and sizes, 1e2 to 1e5 cd/m², at places that keep to no grid, over a dark grey."""
    random = np.random.default_rng(7)
    count = 20
    view = View(512 // shrink, 512 // shrink, FOV_DEG)
    x_px, y_px = random.uniform(0, 1, (2, count)) * [[view.width_px], [view.height_px]]
    radius_px = 10 ** random.uniform(-1.2, -0.2, count) * view.ppd_centre
    luminance_cd_m2 = 10 ** random.uniform(2, 5, count)
    rgb = random.dirichlet((1.0, 1.0, 1.0), count) * 3 * luminance_cd_m2[:, None]
    return CostScene("lamps over dark", _discs(view, LAMPS_DARK_CD_M2, x_px, y_px, radius_px, rgb))


def sun_over_dark(shrink: int = 1) -> CostScene:
    """The sun an eighth of the frame from its upper left corner, all else dark."""
    view = View(512 // shrink, 512 // shrink, FOV_DEG)
    # Off the pixels' grid.
    at_px = np.array([view.width_px / 8 + 0.3])
    radius_px = np.array([SUN_RADIUS_DEG * view.ppd_centre])
    return CostScene("sun over dark", _discs(view, SUN_DARK_CD_M2, at_px, at_px, radius_px, np.full((1, 3), SUN_CD_M2)))


def _discs(
    view: View, dark_cd_m2: float, x_px: np.ndarray, y_px: np.ndarray, radius_px: np.ndarray, rgb: np.ndarray
) -> Frame:
    """Discs of light over the dark; a pixel at an edge has the share that is covered."""
    image = np.full((3, view.height_px, view.width_px), dark_cd_m2)
    rows, columns = (np.arange(side * FINE) for side in image.shape[1:])
    for x, y, radius, light in zip(x_px, y_px, radius_px, rgb, strict=True):
        dy, dx = (rows + 0.5) / FINE - y, (columns + 0.5) / FINE - x
        high, wide = np.abs(dy) < radius, np.abs(dx) < radius
        inside = dy[high, None] ** 2 + dx[None, wide] ** 2 < radius**2
        at = rows[high][:, None] // FINE, columns[wide][None, :] // FINE
        cover = np.zeros(image.shape[1:])
        np.add.at(cover, at, inside / FINE**2)
        image += light[:, None, None] * cover
    return Frame(jnp.asarray(image, jnp.float32)[None], view)


def straight_ahead(frame: Frame, observer: Observer, pose: Pose) -> EyeContext:
    """One eye that stands like this, viewing the middle of a frame."""
    poses = (EyePose(pupil_diameter_mm=pose.pupil_diameter_mm),)
    viewing = view_frame(frame, measure(frame), poses, observer, Display(), Effects(), None, 0.0)
    return dataclasses.replace(viewing.eyes[0], aperture=pose)
