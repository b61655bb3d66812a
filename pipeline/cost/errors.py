"""How far an image is from the truth."""

from __future__ import annotations

import dataclasses
import functools

import jax.numpy as jnp
import numpy as np
from colour import RGB_COLOURSPACES, RGB_to_ICtCp, matrix_RGB_to_RGB
from colour.difference import delta_E_ITP
from jaxtyping import Float
from numpy.typing import NDArray

from entoptic.pipeline.effects import tone
from entoptic.pipeline.frame import LUMINANCE_WEIGHTS, Display
from entoptic.pipeline.oracles.tone import encode

REC709_TO_REC2020 = matrix_RGB_to_RGB(RGB_COLOURSPACES["ITU-R BT.709"], RGB_COLOURSPACES["ITU-R BT.2020"])
"""Linear light between primaries: ICtCp is defined on those of Rec.2020."""


@dataclasses.dataclass(frozen=True)
class Errors:
    """An image against the truth."""

    relative_l2: float
    """Root of the sum of squared differences over the root of the sum of the truth's squares, all channels."""
    worst_cd_m2: float
    """The largest difference of luminance, with its sign: in cd/m² of scene or display, as the image is."""
    worst_x_px: int
    """Where that is: column from the left."""
    worst_y_px: int
    """Row from the top."""
    delta_e_mean: float
    """ΔE ITP (ITU-R BT.2124) of what a display shows; 1 is just noticeable in the best of circumstances."""
    delta_e_p95: float
    """That 95 % of the pixels stay below."""
    share_changed: float
    """Share of the pixels that an sRGB display shows with another code value in any channel."""


@dataclasses.dataclass(frozen=True, eq=False)
class OnDisplay:
    """An image as a display shows it, and what it is compared by."""

    light_cd_m2: Float[np.ndarray, "3 y x"]
    display: Display

    @functools.cached_property
    def ictcp(self) -> NDArray[np.float64]:
        """(y, x, 3), of ITU-R BT.2100."""
        return np.asarray(RGB_to_ICtCp(np.einsum("oi,iyx->yxo", REC709_TO_REC2020, self.light_cd_m2)))

    @functools.cached_property
    def codes(self) -> NDArray[np.uint8]:
        """(y, x, 3), of an sRGB display."""
        peak = self.display.peak_cd_m2
        return encode(self.light_cd_m2 / peak, self.display.black_cd_m2 / peak)


def errors_of(
    image: Float[np.ndarray, "3 y x"], truth: Float[np.ndarray, "3 y x"], exposure: float, display: Display
) -> Errors:
    """Errors of an image in cd/m², with `exposure` in 1/(cd/m²) what the eye's adaptation makes of it.

    Both are linear Rec.709. Differences are taken in float64.
    """
    seen, true = (OnDisplay(shown(of, exposure, display), display) for of in (image, truth))
    return errors_between(image, truth, seen, true)


def errors_between(
    image: Float[np.ndarray, "3 y x"], truth: Float[np.ndarray, "3 y x"], seen: OnDisplay, true: OnDisplay
) -> Errors:
    """Errors of an image, and of what becomes of it on the display."""
    image, truth = np.asarray(image, np.float64), np.asarray(truth, np.float64)
    difference = image - truth
    luminance = np.einsum("c,cyx->yx", np.array(LUMINANCE_WEIGHTS), difference)
    y_px, x_px = np.unravel_index(int(np.abs(luminance).argmax()), luminance.shape)
    delta_e = np.asarray(delta_E_ITP(seen.ictcp, true.ictcp))
    return Errors(
        relative_l2=float(np.linalg.norm(difference) / max(np.linalg.norm(truth), np.finfo(float).tiny)),
        worst_cd_m2=float(luminance[y_px, x_px]),
        worst_x_px=int(x_px),
        worst_y_px=int(y_px),
        delta_e_mean=float(delta_e.mean()),
        delta_e_p95=float(np.percentile(delta_e, 95)),
        share_changed=float((seen.codes != true.codes).any(axis=2).mean()),
    )


def shown(image: Float[np.ndarray, "3 y x"], exposure: float, display: Display) -> Float[np.ndarray, "3 y x"]:
    """What a display shows of an image in cd/m², in the display's own cd/m²."""
    tone_mapped = tone.aces(jnp.asarray(image, jnp.float32)[None], jnp.asarray([exposure]), display.peak_cd_m2)[0]
    return np.asarray(tone_mapped, np.float64) * display.peak_cd_m2
