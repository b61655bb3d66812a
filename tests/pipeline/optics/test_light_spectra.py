"""Spectra of displays and lights."""

from pathlib import Path

import colour
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from entoptic.pipeline.optics import OpticsError, light_spectra

LUMINANCE = np.asarray(colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_RGB_to_XYZ)[1]


@given(st.integers(*light_spectra.WAVELENGTHS_RANGE))
def test_each_primary_keeps_its_colour_for_any_number_of_wavelengths(count: int) -> None:
    nm, weights = light_spectra.primary_weights(count)
    assert nm.shape == (count,)
    assert weights.shape == (count, 3, 3)
    assert np.abs(weights.sum(axis=0) - np.eye(3)).max() < 1e-12
    assert np.einsum("o,loi->li", LUMINANCE, weights).min() > 0
    assert light_spectra.RANGE_NM[0] < nm[0] < nm[-1] < light_spectra.RANGE_NM[1]


def test_the_primaries_spectra_are_lights_that_make_d65_and_have_the_primaries_xyz() -> None:
    nm, spectra = light_spectra.primaries()
    assert spectra.min() > 0
    d65 = np.asarray(colour.SDS_ILLUMINANTS["D65"][nm])
    ratio = spectra.sum(axis=1) / d65
    assert np.ptp(ratio) < 0.002 * ratio.mean()
    cmfs = np.asarray(colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"][nm])
    to_xyz = np.asarray(colour.RGB_COLOURSPACES["ITU-R BT.709"].matrix_RGB_to_XYZ)
    assert cmfs.T @ spectra == pytest.approx(to_xyz, abs=2e-4)


def test_a_primarys_light_lies_where_it_should() -> None:
    """Mean wavelength of the luminance of each."""
    nm, weights = light_spectra.primary_weights()
    luminance = np.einsum("o,loi->li", LUMINANCE, weights)
    red, green, blue = (nm @ luminance) / luminance.sum(axis=0)
    assert 595 < red < 630
    assert 530 < green < 560
    assert 460 < blue < 500


@pytest.mark.parametrize("name", light_spectra.names())
def test_every_named_light_has_luminance_1(name: str) -> None:
    nm, weights = light_spectra.light_weights(name)
    assert weights.shape == (len(nm), 3)
    assert weights.sum(axis=0) @ LUMINANCE == pytest.approx(1, abs=1e-12)


def test_the_primaries_together_are_d65() -> None:
    of_primaries = light_spectra.primary_weights(16)[1].sum(axis=2)
    of_white = light_spectra.light_weights("D65", 16)[1]
    assert np.abs(of_primaries - of_white).max() < 2e-3


@pytest.mark.parametrize(("name", "rgb"), [("D65", (1, 1, 1)), ("E", (1.205, 0.948, 0.909))])
def test_colours_of_known_lights(name: str, rgb: tuple[float, float, float]) -> None:
    assert light_spectra.light_weights(name)[1].sum(axis=0) == pytest.approx(rgb, abs=1e-3)


def test_colours_do_not_depend_on_the_number_of_wavelengths() -> None:
    """Not even of narrow lines: a band holds its sum."""
    few, many = (light_spectra.light_weights("LED-KRI-3", count)[1].sum(axis=0) for count in (4, 128))
    assert few == pytest.approx(many, abs=1e-12)


def test_kris_white_led_has_a_blue_peak_and_a_gap_before_the_green() -> None:
    nm, weights = light_spectra.light_weights("LED-KRI", 128)
    blue = weights[:, 2]
    assert nm[np.argmax(blue)] == pytest.approx(450, abs=4)
    tungsten = light_spectra.light_weights("tungsten", 128)[1]
    assert np.array_equal(tungsten, light_spectra.light_weights("A", 128)[1])


def test_a_file_gives_the_same_light_as_its_table(tmp_path: Path) -> None:
    table = colour.SDS_ILLUMINANTS["A"]
    path = tmp_path / "lamp.csv"
    rows = "\n".join(f"{nm},{power}" for nm, power in zip(table.wavelengths, table.values, strict=True))
    path.write_text("# a lamp\nnm,power\n" + rows + "\n", encoding="utf-8")
    assert light_spectra.light_weights(path)[1] == pytest.approx(light_spectra.light_weights("A")[1], abs=1e-12)


@pytest.mark.parametrize(
    ("content", "what"),
    [
        ("", "has 0 rows"),
        ("nm,power\n500,1\n", "has 1 rows"),
        ("nm,power\n500,1\nred,1\n", "row 3 is 'red,1'"),
        ("500,1\n510,1,2\n", "row 2 is"),
        ("500,1\n510,-1\n", "row 2 is"),
        ("500,1\n510,nan\n", "row 2 is"),
        ("500,1\n490,1\n", "490 nm comes after 500 nm"),
        ("500,1\n510,\xff\n", "cannot be read"),
        ("900,1\n910,1\n", "no light that is seen"),
    ],
)
def test_a_bad_file_is_refused_by_name(tmp_path: Path, content: str, what: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(content.encode("latin-1"))
    with pytest.raises(OpticsError, match=what) as refused:
        light_spectra.light_weights(path)
    assert "bad.csv" in str(refused.value)


def test_unknown_names_and_counts_are_refused_and_name_what_there_is(tmp_path: Path) -> None:
    with pytest.raises(OpticsError, match=r"'neon'.*LED-KRI.*D65"):
        light_spectra.light_weights("neon")
    with pytest.raises(OpticsError, match="cannot be read"):
        light_spectra.light_weights(tmp_path / "none.csv")
    for count in (3, 129):
        with pytest.raises(OpticsError, match=f"{count} wavelengths: use 4 to 128"):
            light_spectra.primary_weights(count)
