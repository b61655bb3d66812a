"""What a game engine is told, and that it is enough to apply the effects."""

import subprocess
import sys
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline import EyePose, Frame, Glare, GlareLevel, GlareModel, Perceived, Planning, RenderState, perceive
from entoptic.pipeline.effects.glare import GLARE
from entoptic.pipeline.effects.glare.kernel import Mixture, Part
from entoptic.pipeline.effects.glare.settings import Edge
from entoptic.pipeline.sinks.images import write_exr
from entoptic.services.ipc import messages
from entoptic.services.ipc.messages import (
    EngineFrame,
    EngineKernel,
    EyeShown,
    LatencyMs,
    MessageError,
    Picture,
    Shown,
    decode,
)
from entoptic.services.rendering import Rendered
from entoptic.services.settings import Settings
from entoptic.services.worker.engine import LEAST_STEP, Held, KernelNumbers, engine_frame, engine_kernel
from entoptic.services.worker.publish import LivePublisher
from entoptic.tracker_bridge.wire import Eye

EXAMPLE = Path(__file__).parents[2] / "examples" / "engine_consumer.py"
KINDS = (Picture, Shown, EngineFrame, EngineKernel)
POSE = EyePose(6.0, -3.0, 4.0)


def asked(model: GlareModel, level: GlareLevel) -> Settings:
    return Settings(glare=Glare(model, level, Edge.DARK), plan=Planning(everything=True))


def room() -> Frame:
    """Grey, from starlight to a lamp, with a coloured wall."""
    light = np.full((160, 200, 3), 0.02, np.float32) * np.geomspace(0.05, 400, 200, dtype=np.float32)[:, None]
    light[40:60, 20:60] *= (1.0, 0.5, 0.2)
    light[80:84, 120:124] = 20_000
    return Frame.from_rgb(light, 50.0)


def rendered_of(frame: Frame, wanted: Settings, state: RenderState | None = None) -> tuple[Rendered, Perceived]:
    perceived = perceive(frame, POSE, effects=wanted, display=wanted.display, planning=wanted.plan, state=state)
    return Rendered(1, 0.0, None, (POSE,), frame, perceived, 0.0), perceived


def as_an_engine_shows_it(rendered: Rendered, wanted: Settings, folder: Path) -> np.ndarray:
    """What the example makes of real messages and the same frame."""
    write_exr(folder / "scene.exr", np.asarray(rendered.frame.rgb_cd_m2[0]).transpose(1, 2, 0))
    publisher = LivePublisher("tcp://127.0.0.1:*")
    command = [sys.executable, EXAMPLE, publisher.address, folder / "out.png", "--scene", folder / "scene.exr"]
    with subprocess.Popen([*command, "--fov", str(rendered.frame.view.fov_deg)]) as engine:
        deadline = time.monotonic() + 60
        while engine.poll() is None and time.monotonic() < deadline:
            publisher.show(
                rendered,
                (Eye.LEFT,),
                wanted,
                t_ns=time.monotonic_ns(),
                fps=24.0,
                reached_fps=24.0,
                dropped=0,
                latency=lambda: None,
                sink_ms=0.0,
                recording=None,
            )
            time.sleep(0.02)
        engine.kill()
    publisher.close()
    assert engine.returncode == 0
    import OpenImageIO as oiio

    return np.asarray(oiio.ImageBuf(str(folder / "out.png")).get_pixels(oiio.UINT8))


def test_the_example_shows_nearly_what_the_worker_does(tmp_path: Path) -> None:
    wanted = asked(GlareModel.CIE, GlareLevel.HALF)
    rendered, perceived = rendered_of(room(), wanted, RenderState((0.5,)))
    shown = as_an_engine_shows_it(rendered, wanted, tmp_path)
    difference = np.abs(shown.astype(int) - perceived.image[0])
    # The veil's tiles are coarse; all else is the same.
    assert difference.mean() < 1
    assert difference.max() <= 12
    assert np.abs(shown.astype(int).mean() - perceived.image[0].mean()) < 0.5


@pytest.mark.slow
def test_the_example_with_wave_optics(tmp_path: Path) -> None:
    wanted = asked(GlareModel.WAVE, GlareLevel.HALF)
    rendered, perceived = rendered_of(room(), wanted, RenderState((0.5,)))
    difference = np.abs(as_an_engine_shows_it(rendered, wanted, tmp_path).astype(int) - perceived.image[0])
    assert difference.mean() < 1.5


def coloured(seed: int = 0, side: int = 21) -> Mixture:
    """A kernel from each channel to each, that falls by six decades."""
    rng = np.random.default_rng(seed)
    y, x = np.indices((side, side)) - side // 2
    fall = 0.02 * 10.0 ** -(0.43 * np.hypot(y, x))

    def part() -> Part:
        cells = fall * (np.eye(3) + 0.1 * rng.random((3, 3)))[:, :, None, None]
        cells[:, :, side // 2, side // 2] += np.eye(3) - cells.sum(axis=(2, 3))
        return Part(lambda per_deg, radius, wider: cells, None)

    return (part(), 0.3), (part(), 0.7)


def test_a_kernel_gives_white_light_what_all_channels_give_and_makes_none() -> None:
    mixture = coloured()
    kernel = engine_kernel(Held(5, mixture, 0), Eye.RIGHT, 10.0)
    exact = sum(weight * part.cells(10.0, 10, 1.0).sum(axis=1) for part, weight in mixture).transpose(1, 2, 0)
    middle = kernel.side // 2
    around = kernel.around.astype(np.float64)
    assert (kernel.number, kernel.eye, kernel.side) == (5, "right", 21)
    assert not around[middle, middle].any()
    np.testing.assert_allclose(np.array(kernel.stays_rgb), exact[middle, middle], atol=3e-5)
    exact[middle, middle] = 0
    np.testing.assert_allclose(around, exact, rtol=2**-11)
    np.testing.assert_allclose(around.sum(axis=(0, 1)) + np.array(kernel.stays_rgb), 1, atol=1e-7)


def test_the_veil_of_a_formula_adds_up_to_its_share() -> None:
    _, perceived = rendered_of(room(), asked(GlareModel.CIE, GlareLevel.HALF))
    kernel = engine_kernel(Held(1, GLARE.prepared(perceived.eyes[0]).kernel, 0), Eye.LEFT, 10.0)
    deg = np.linspace(0, 90, 100_001)
    density = np.interp(deg, kernel.veil_deg, kernel.veil_per_sr, left=0, right=0)
    total = np.trapezoid(density * 2 * np.pi * np.sin(np.radians(deg)), np.radians(deg))
    assert total == pytest.approx(kernel.veil_share, rel=0.01)


def test_a_kernel_has_another_number_when_it_has_changed_and_not_too_often() -> None:
    (one, _), (other, _) = coloured()
    numbers = KernelNumbers(0)

    def at(t_s: float, weight: float, eye: Eye = Eye.LEFT) -> int:
        return numbers.number(eye, ((one, weight), (other, 1 - weight)), int(t_s * 1e9))

    assert at(0, 0.5) == 1
    assert at(0, 0.5, Eye.RIGHT) == 2
    assert at(1, 0.5 + LEAST_STEP / 2) == 1
    assert at(2, 0.5 + LEAST_STEP) == 3
    assert at(2.05, 0.9) == 3
    assert at(2.11, 0.9) == 4
    assert numbers.held[Eye.LEFT].number == 4
    # A second of a pupil in motion, at 100 frames a second.
    moving = {at(3 + k / 100, k / 100) for k in range(100)}
    assert len(moving) <= 11


def examples() -> list[msgspec.Struct]:
    wanted = asked(GlareModel.CIE, GlareLevel.HALF)
    rendered, perceived = rendered_of(room(), wanted)
    eye = EyeShown("left", "blink", (1.0, 2.0), (3.0, 4.0), 4.0, 0.5, 1.0, 2.0, 3.0)
    return [
        Picture(1, 2, 1, 1, "srgb", "uint8", b"abc"),
        Shown(1, 0.1, 2, 3, 4, (eye,), (), 0.5, {"glare": 1.0}, None, 24.0, 23.0, 0, LatencyMs(1.0, 2.0, 3.0), None),
        engine_frame(rendered, (Eye.LEFT,), wanted, wanted.display, (1,), 3),
        engine_kernel(Held(1, GLARE.prepared(perceived.eyes[0]).kernel, 0), Eye.LEFT, 10.0),
    ]


def test_every_record_comes_back_as_it_went() -> None:
    for record in examples():
        assert decode(messages.encode(record), type(record)) == record


@given(st.binary(max_size=200), st.sampled_from(KINDS))
def test_any_bytes_are_a_message_or_refused(said: bytes, kind: type[msgspec.Struct]) -> None:
    with pytest.raises(MessageError):
        decode(said, kind)


@given(st.data())
def test_a_damaged_message_is_read_or_refused(data: st.DataObject) -> None:
    record = Picture(1, 2, 1, 1, "srgb", "uint8", b"abc")
    message = bytearray(messages.encode(record))
    for _ in range(data.draw(st.integers(1, 4))):
        message[data.draw(st.integers(0, len(message) - 1))] = data.draw(st.integers(0, 255))
    try:
        picture = decode(bytes(message), Picture)
        assert picture.image.shape == (picture.height_px, picture.width_px, 3)
    except MessageError:
        pass


def test_another_version_and_endless_nesting_are_refused() -> None:
    with pytest.raises(MessageError, match="version 9"):
        decode(msgspec.msgpack.encode({"entoptic": 9, "body": {}}), Shown)
    with pytest.raises(MessageError):
        decode(b"\x91" * 100_000, Shown)
