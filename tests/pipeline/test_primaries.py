"""XYZ of Rec.709 against colour-science, the standard's chromaticities, and the luminance of the rest."""

from __future__ import annotations

import colour
import numpy as np

from entoptic.pipeline.effects.encode import REC709, to_xyz
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS
from entoptic.pipeline.primaries import RGB_TO_XYZ, SUM_WEIGHTS, X_WEIGHTS, XYZ_TO_RGB, Z_WEIGHTS


def test_the_matrix_is_the_standards() -> None:
    published = colour.RGB_COLOURSPACES["sRGB"].matrix_RGB_to_XYZ
    np.testing.assert_allclose(RGB_TO_XYZ, published, rtol=0, atol=2.1e-4)
    np.testing.assert_allclose(RGB_TO_XYZ, to_xyz(REC709), rtol=0, atol=3e-4)
    np.testing.assert_allclose(np.array(XYZ_TO_RGB) @ np.array(RGB_TO_XYZ), np.eye(3), atol=1e-14)


def test_y_is_the_luminance_of_the_rest() -> None:
    assert RGB_TO_XYZ[1] == LUMINANCE_WEIGHTS
    np.testing.assert_allclose(SUM_WEIGHTS, (0.6443903, 1.1919681, 1.2029416), atol=1e-12)


def test_white_is_d65() -> None:
    """ASTM E308's white point."""
    np.testing.assert_allclose((sum(X_WEIGHTS), sum(Z_WEIGHTS)), (0.95047, 1.08883), atol=1.5e-5)
