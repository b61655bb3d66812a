import math

import numpy as np
import pytest

from entoptic.pipeline.frame import FrameError, View
from entoptic.pipeline.scenes.scene import Head, count_eyes, headset_view, rays, rotation
from entoptic.tracker_bridge.wire import Eye

HEADS = [Head(), Head(30, 0, 0), Head(-170, 40, 0), Head(10, -20, 25), Head(0, 90, 0), Head(725, 5, -60)]


@pytest.mark.parametrize("head", HEADS)
def test_axes_are_orthonormal(head: Head) -> None:
    axes = rotation(head)
    assert axes.dtype == np.float32
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-6)


@pytest.mark.parametrize(
    ("head", "right", "up", "forward"),
    [
        (Head(), (1, 0, 0), (0, 1, 0), (0, 0, 1)),
        (Head(yaw_deg=90), (0, 0, -1), (0, 1, 0), (1, 0, 0)),
        (Head(pitch_deg=90), (1, 0, 0), (0, 0, -1), (0, 1, 0)),
        (Head(roll_deg=90), (0, -1, 0), (1, 0, 0), (0, 0, 1)),
    ],
)
def test_turns_go_the_way_they_are_named(
    head: Head, right: tuple[int, ...], up: tuple[int, ...], forward: tuple[int, ...]
) -> None:
    np.testing.assert_allclose(rotation(head).T, [right, up, forward], atol=1e-7)


def test_rays_look_where_pixel_of_says() -> None:
    view = View(64, 40, 90.0)
    x, y, z = np.asarray(rays(view, rotation(Head())))
    for row, column in ((0, 0), (39, 63), (20, 5)):
        azimuth = math.degrees(math.atan2(x[row, column], z[row, column]))
        elevation = math.degrees(math.atan2(y[row, column], math.hypot(x[row, column], z[row, column])))
        assert view.pixel_of(azimuth, elevation) == pytest.approx((column + 0.5, row + 0.5), abs=1e-3)


def test_a_view_keeps_the_aspect_of_the_headset() -> None:
    assert headset_view(None, None, 104.0) == View(720, 800, 104.0)
    assert headset_view(360, None, 104.0) == View(360, 400, 104.0)
    assert headset_view(None, 400, 104.0) == View(360, 400, 104.0)
    assert headset_view(50, 20, 30.0) == View(50, 20, 30.0)


@pytest.mark.parametrize("eyes", [(), (Eye.LEFT, Eye.LEFT), (Eye.LEFT, Eye.RIGHT, Eye.LEFT)])
def test_a_frame_is_for_one_eye_or_both(eyes: tuple[Eye, ...]) -> None:
    with pytest.raises(FrameError, match="one eye, or for both"):
        count_eyes(eyes)
