import os
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from entoptic.errors import OutputError
from entoptic.pipeline.scenes.image_file import cd_m2_per_unit, read
from entoptic.pipeline.sinks.images import write_exr, write_png


def test_png_comes_back_as_it_was(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (7, 5, 3), dtype=np.uint8)
    write_png(tmp_path / "a.png", image)
    np.testing.assert_array_equal(oiio.ImageBuf(str(tmp_path / "a.png")).get_pixels(oiio.UINT8), image)


def test_exr_comes_back_in_cd_m2_from_starlight_to_sun(tmp_path: Path) -> None:
    image = np.random.default_rng(0).uniform(0, 1, (7, 5, 3)).astype(np.float32)
    image[0, 0] = (0.0, 1e-6, 1.6e9)
    write_exr(tmp_path / "a.exr", image)
    file = read(tmp_path / "a.exr")
    scale, _ = cd_m2_per_unit(file, None)
    assert scale == 1.0
    assert file.notes == ()
    np.testing.assert_array_equal(file.rgb * np.float32(scale), image.transpose(2, 0, 1))


def test_same_frame_same_bytes(tmp_path: Path) -> None:
    image = np.random.default_rng(0).uniform(0, 1, (7, 5, 3)).astype(np.float32)
    for name in ("a", "b"):
        write_exr(tmp_path / f"{name}.exr", image)
        write_png(tmp_path / f"{name}.png", (image * 255).astype(np.uint8))
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.exr", "a.png", "b.exr", "b.png"]


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"nowhere/a\.png cannot be written.*check its folder"):
        write_png(tmp_path / "nowhere" / "a.png", np.zeros((4, 4, 3), np.uint8))
    with pytest.raises(OutputError, match=r"nowhere/a\.exr cannot be written.*check its folder"):
        write_exr(tmp_path / "nowhere" / "a.exr", np.zeros((4, 4, 3), np.float32))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full, which is a disk without space")
@pytest.mark.parametrize("suffix", ["png", "exr"])
def test_a_full_disk_is_an_error_and_leaves_nothing(tmp_path: Path, suffix: str) -> None:
    os.symlink("/dev/full", tmp_path / f".a.partial.{suffix}")
    noise = np.random.default_rng(0).integers(0, 256, (200, 200, 3), dtype=np.uint8)
    write, image = (write_png, noise) if suffix == "png" else (write_exr, noise.astype(np.float32))
    with pytest.raises(OutputError, match=rf"a\.{suffix} cannot be written"):
        write(tmp_path / f"a.{suffix}", image)
    assert list(tmp_path.iterdir()) == []
