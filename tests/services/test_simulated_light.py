from pathlib import Path

import pytest

from entoptic.pipeline.scenes import open_scene
from entoptic.services import simulated_light
from entoptic.tracker_bridge.source import SourceError


def test_a_number_is_that_luminance_for_ever() -> None:
    assert simulated_light.read("12.5") == ((0.0, 12.5),)


def test_a_scenes_light_comes_back_from_its_table(tmp_path: Path) -> None:
    scene = open_scene("night-street")
    steps = simulated_light.of_scene(scene, scene.view_for(None, None, 104.0), "still", 5.0)
    assert len(steps) == 26
    # The full beam at 4 s is the brightest moment of an approach.
    assert max(steps, key=lambda step: step[1])[0] == pytest.approx(4.4, abs=0.3)
    path = tmp_path / "light.csv"
    simulated_light.write(path, steps)
    back = simulated_light.read(str(path))
    assert [t for t, _ in back] == pytest.approx([t for t, _ in steps])
    assert [light for _, light in back] == pytest.approx([light for _, light in steps], rel=1e-5)


@pytest.mark.parametrize("spec", ["-1", "0", "nan", "inf", "nowhere.csv"])
def test_what_is_neither_a_luminance_nor_a_table_is_named(spec: str) -> None:
    with pytest.raises(SourceError, match=spec.replace(".", r"\.")):
        simulated_light.read(spec)


@pytest.mark.parametrize(
    ("text", "named"), [("", "t_s,cd_m2"), ("t_s,cd_m2\n", "a row"), ("t_s,cd_m2\n0,x\n", "line 2")]
)
def test_a_bad_table_is_named_with_its_line(tmp_path: Path, text: str, named: str) -> None:
    path = tmp_path / "light.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SourceError, match=named):
        simulated_light.read(str(path))
