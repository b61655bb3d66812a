"""CIE XYZ of linear Rec.709 RGB with D65 white (ITU-R BT.709): what effects on colour work with.

Its Y is exactly the luminance of the rest of the pipeline, whose weights the standard rounds to four digits; so a grey
keeps its luminance and no effect has another Y than the measurement. Between display primaries: effects/encode.py.
"""

from __future__ import annotations

import numpy as np

from entoptic.pipeline.frame import LUMINANCE_WEIGHTS

X_WEIGHTS = (0.4124564, 0.3575761, 0.1804375)
Z_WEIGHTS = (0.0193339, 0.1191920, 0.9503041)
RGB_TO_XYZ = (X_WEIGHTS, LUMINANCE_WEIGHTS, Z_WEIGHTS)
"""(XYZ, RGB)."""
XYZ_TO_RGB = tuple(tuple(row) for row in np.linalg.inv(RGB_TO_XYZ).tolist())
"""(RGB, XYZ)."""
SUM_WEIGHTS = tuple(sum(column) for column in zip(*RGB_TO_XYZ, strict=True))
"""X + Y + Z of the primaries: 0.6443903, 1.1919681, 1.2029416."""
