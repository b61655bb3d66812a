"""What a live worker publishes: pictures, plans, and what a game engine needs to apply the effects itself.

Every message has two parts: its topic, by which to subscribe, and one msgpack map with `entoptic`, the version, and
`body`, a record with its field names as keys. A reader that is slow misses messages, never delays them; what it gets is
whole. docs/wire-format.md says it for other languages.
"""

from __future__ import annotations

from typing import Final, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

VERSION: Final = 1
PERCEIVED, DISPLAYED, SHOWN, ENGINE, KERNEL = b"perceived", b"displayed", b"shown", b"engine", b"kernel"
TOPICS: Final = (PERCEIVED, DISPLAYED, SHOWN, ENGINE, KERNEL)
DTYPES: Final = ("uint8", "uint16", "float32")

Body = TypeVar("Body")


class MessageError(Exception):
    """A message cannot be read."""


class Picture(msgspec.Struct, frozen=True):
    """A frame as perceived (topic `perceived`), or as displayed without an eye (topic `displayed`)."""

    frame: int
    t_ns: int
    """When it was begun, on the worker's monotonic clock."""
    width_px: int
    """Of all eyes' images together: they stand side by side."""
    height_px: int
    encoding: str
    """As of pipeline.Encoding: what the code values mean."""
    dtype: str
    """uint8, uint16 or float32, little endian."""
    pixels: bytes
    """Rows from the top, each of `width_px` times red, green, blue."""

    @property
    def image(self) -> NDArray[np.generic]:
        """(y, x, 3). Raises MessageError where it has not the size that it says."""
        if self.dtype not in DTYPES:
            raise MessageError(f"a picture of {self.dtype}: known are {', '.join(DTYPES)}")
        dtype = np.dtype(self.dtype).newbyteorder("<")
        expected = 3 * self.width_px * self.height_px * dtype.itemsize
        if min(self.width_px, self.height_px) < 1 or len(self.pixels) != expected:
            raise MessageError(f"a picture of {self.width_px}×{self.height_px} pixels with {len(self.pixels)} bytes")
        return np.frombuffer(self.pixels, dtype).reshape(self.height_px, self.width_px, 3)


class EyeShown(msgspec.Struct, frozen=True):
    """One eye, as the frame was rendered for it."""

    eye: str
    """left or right."""
    phase: str
    """As of tracker_bridge.wire.Phase; `none` where no bridge says anything."""
    gaze_deg: tuple[float, float]
    """To the right and up, from straight ahead of the head."""
    gaze_px: tuple[float, float]
    """In this eye's image, from its upper left corner."""
    pupil_diameter_mm: float
    openness: float
    adapted_cd_m2: float
    mean_cd_m2: float
    max_cd_m2: float


class StepShown(msgspec.Struct, frozen=True):
    """What the plan said of one effect."""

    effect: str
    level: str
    runs: bool
    reason: str
    bound_code_values: float
    ms: float
    """0 where it did not run."""
    fading_from: str | None = None
    """The level before, while the picture still passes from it."""
    fade: float = 1.0
    """How far it has come, 0 to 1."""


class LatencyMs(msgspec.Struct, frozen=True):
    """From the sample to the light, of the newest sample in a frame, all on one machine's clock."""

    sample_to_state: float
    """Until the bridge published the state."""
    state_to_frame: float
    """Until the worker began a frame with it."""
    frame_to_sink: float
    """Until the frame was kept and its pictures published."""

    @property
    def total(self) -> float:
        """All of it."""
        return self.sample_to_state + self.state_to_frame + self.frame_to_sink


class Shown(msgspec.Struct, frozen=True):
    """What a person who watches wants to know of a frame (topic `shown`)."""

    frame: int
    t_s: float
    """Since the worker's first frame."""
    t_ns: int
    """When it was begun, on the worker's monotonic clock."""
    width_px: int
    height_px: int
    """Of one eye's image."""
    eyes: tuple[EyeShown, ...]
    plan: tuple[StepShown, ...]
    bound_code_values: float
    """What all skips together change at most."""
    milliseconds: dict[str, float]
    """Of each part: scene, measure, kernel, plan, each effect that ran, encode, and `sink`."""
    budget_ms: float | None
    fps: float
    """Asked for."""
    reached_fps: float
    """Frames in the last second or so."""
    dropped: int
    """Frames left out so far."""
    latency: LatencyMs | None
    """None where no state was fresh, or came from another machine's clock."""
    recording: str | None
    """The folder in which all is recorded; None while nothing is."""


class EngineEye(msgspec.Struct, frozen=True):
    """What to apply to one eye's image. Images are linear Rec.709 in cd/m², right after the scene was drawn."""

    eye: str
    """left or right."""
    gaze_deg: tuple[float, float]
    """To the right and up, from straight ahead of the head."""
    openness: float
    """0 lid closed … 1 open."""
    blink: bool
    """Whether a lid moves or is down: the phases closing, blink and opening."""
    pupil_diameter_mm: float
    adapted_cd_m2: float
    glare: str
    """The level; `skipped` and `off` mean that there is nothing to do."""
    kernel: int
    """The number of the kernel message that belongs to it; 0 while no glare runs."""
    glare_weight: float
    """How much of what kernel and veil change is to be applied, 0 to 1: between them while glare fades in or out."""
    glare_ceiling_cd_m2: float | None
    """Where given, only a pixel's light above this luminance scatters."""
    acuity: str
    """The level; `fit`: blur luminance by a Gaussian of σ = max(1 − L*, 0) px, L* of the pixel's luminance in cd/m²."""
    acuity_weight: float
    """How much of what the blur changes is to be applied."""
    acuity_sigma_px: float
    """σ for a pixel of the luminance that the eye is adapted to; for engines that blur the frame evenly."""
    tone: str
    """The operator."""
    hue: str
    """What becomes of colours beyond the display's: oklab, clip, rgb or xyy."""
    exposure: float
    """1/(cd/m²): what to multiply the image by before the tone curve."""
    tone_numbers: tuple[float, ...]
    """The operator's numbers for this eye, the exposure first where it has one (docs/engine.md)."""
    night_colour: str
    """The method."""
    tint_rgb: tuple[float, float, float]
    """Linear, of 1 cd/m² of grey."""
    tint_share: float
    """How far colours go to luminance·tint, 0 to 1, after the tone curve; 0 where night colour does not run."""
    rod_weights: tuple[float, float, float]
    """By which red, green and blue are weighed for that luminance."""


class EngineFrame(msgspec.Struct, frozen=True):
    """What a game engine needs to apply the effects itself, once a frame (topic `engine`)."""

    frame: int
    t_ns: int
    """When the worker began its own frame, on its monotonic clock."""
    eyes: tuple[EngineEye, ...]
    """Left to right."""
    display_peak_cd_m2: float
    """The 1 of the picture after the tone curve, with what the screen reflects."""
    display_black_share: float
    """Of it, what the screen shows for black: to be taken away before encoding, the rest spread over 0 to 1."""


class EngineKernel(msgspec.Struct, frozen=True):
    """A glare kernel (topic `kernel`): when it changes, and again whenever somebody subscribes.

    What a pixel of white light becomes. A pixel keeps `stays_rgb` of its light, those around it get `rgb`·`scale`, and
    the veil takes `veil_share`; these add up to 1 in each channel, so a plain wall stays as it is in any colour.
    """

    number: int
    eye: str
    """left or right."""
    side: int
    """Odd; the light's own pixel is in the middle."""
    pixels_per_deg: float
    """In the middle of the view. A view of other pixels per degree needs it resized, and its sum kept."""
    rgb: bytes
    """Half floats, little endian: [row][column][red, green, blue]; to be multiplied by `scale`. 0 in the middle."""
    scale: float
    """A power of two, such that half floats hold both the first ring and the last one with all their digits."""
    stays_rgb: tuple[float, float, float]
    """What the light's own pixel keeps."""
    veil_share: float
    """Light that goes farther than the kernel reaches."""
    veil_deg: tuple[float, ...]
    """Angles from the light, ascending; beyond the last one the veil is 0, straight between two of them."""
    veil_per_sr: tuple[float, ...]
    """The veil there: luminance for each cd/m² and steradian of a light."""

    @property
    def around(self) -> NDArray[np.float32]:
        """(row, column, 3): `rgb`·`scale`. Raises MessageError where it has not the size that it says."""
        halves = np.frombuffer(self.rgb, "<f2") if len(self.rgb) % 2 == 0 else np.zeros(0)
        if self.side < 1 or self.side % 2 == 0 or halves.size != 3 * self.side**2:
            raise MessageError(f"a kernel of {self.side}×{self.side} pixels with {len(self.rgb)} bytes")
        return halves.reshape(self.side, self.side, 3).astype(np.float32) * np.float32(self.scale)


_encoder = msgspec.msgpack.Encoder()


class _Envelope(msgspec.Struct, frozen=True):
    entoptic: int
    body: msgspec.Raw


def encode(body: msgspec.Struct) -> bytes:
    """The second part of a message."""
    return _encoder.encode({"entoptic": VERSION, "body": body})


def decode(message: bytes, kind: type[Body]) -> Body:
    """The body of a message's second part. Raises MessageError that says what is wrong."""
    try:
        envelope = msgspec.msgpack.decode(message, type=_Envelope)
        if envelope.entoptic != VERSION:
            raise MessageError(f"a message of version {envelope.entoptic}, this program reads version {VERSION}")
        return msgspec.msgpack.decode(envelope.body, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise MessageError(f"no message of a worker: {error}") from None
