"""A new effect is one new file and one line: all else finds it."""

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOY = '''
"""Half of the light is gone."""

from typing import Annotated

import msgspec
import numpy as np

from entoptic.pipeline.effects.effect import Cost, Domain, Effect


class Dimming(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How much light is left."""

    share: Annotated[float, msgspec.Meta(ge=0.1, le=1.0, description="Light that is left of all.")] = 0.5


class DimmingEffect(Effect[Dimming, None]):
    """Half of the light is gone."""

    name = "dimming"
    domain = Domain.SCENE
    Settings = Dimming
    costs = {"on": Cost(0.1, 0.1)}

    def full_level(self, settings):
        return "on"

    def apply(self, picture, eyes, settings, level, tiles):
        return picture.image * np.float32(settings.share)

    def bound(self, ranges, eye, settings, level):
        return ranges.image.high * (1 - settings.share)

    def propagate(self, changes, ranges, eye, settings):
        return changes.image * settings.share

    def reason(self, eye, settings):
        return f"{settings.share:g} of the light is left"

    def oracle(self, picture, eye, settings):
        return np.asarray(picture.image[0], np.float64) * settings.share

    def variants(self):
        return {"half": Dimming(), "a third": Dimming(1 / 3)}


DIMMING = DimmingEffect()
'''
LOOK = """
import json, sys
import numpy as np
from entoptic import EFFECTS, EyePose, Frame, Planning, perceive
from entoptic.services.console.fields import fields
from entoptic.services.config import SettingsConfig
from entoptic.services.settings import SettingsError, load, of

from entoptic.pipeline.cost.everything import measure_effect
from entoptic.pipeline.cost.scenes import scene
from entoptic.pipeline.cost.viewing import SceneViewing
from entoptic.pipeline.cost.whole_frame import COMBINED

toy = next(effect for effect in EFFECTS if effect.name == "dimming")
rows = measure_effect(toy, SceneViewing(scene("dusk", 24, 26)), 0)
frame = Frame.from_rgb(np.full((40, 40, 3), 5.0), 40.0)
seen = perceive(frame, EyePose(pupil_diameter_mm=4.0))
without = perceive(frame, EyePose(pupil_diameter_mm=4.0), planning=Planning(leave_out=frozenset({"dimming"})))
step = seen.plan["dimming"]
loaded = load("dim.toml")
sys.path.insert(0, sys.argv[1])
import observer_file
try:
    of(SettingsConfig(without=("nothing",)))
except SettingsError as error:
    unknown = str(error)
print(json.dumps({
    "order": [effect.name for effect in EFFECTS],
    "plan": [step.level, step.reason],
    "changed": float(np.abs(np.asarray(seen.linear) - np.asarray(without.linear)).max()),
    "bound": without.plan.bound_code_values,
    "skipped": without.plan["dimming"].level,
    "settings": loaded.dimming.share,
    "form": [[field.path, field.help, field.low, field.high] for field in fields() if "dimming" in field.path],
    "documents": observer_file.tables(),
    "option": of(SettingsConfig(changes=("dimming.share=0.75",))).dimming.share,
    "left_out": sorted(of(SettingsConfig(without=("dimming",))).plan.leave_out),
    "unknown": unknown,
    "cost": {row.setting: [row.errors.relative_l2, row.median_ms] for row in rows},
    "combined": [effect.name for effect in COMBINED],
}))
"""


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the program with the toy in it."""
    root = tmp_path_factory.mktemp("checkout")
    for name in ("src", "pipeline", "services", "tracker_bridge", "docs"):
        shutil.copytree(ROOT / name, root / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__", "*.png"))
    (root / "pipeline" / "effects" / "dimming.py").write_text(TOY)
    listed = root / "pipeline" / "effects" / "__init__.py"
    before = listed.read_text()
    listed.write_text(before.replace('        "rod_noise",\n', '        "dimming",\n        "rod_noise",\n'))
    assert len(listed.read_text().splitlines()) == len(before.splitlines()) + 1
    (root / "dim.toml").write_text("[dimming]\nshare = 0.25\n")
    return root


def run(checkout: Path, *arguments: str) -> str:
    return subprocess.run(
        [sys.executable, "-P", *arguments],
        cwd=checkout,
        env={**os.environ, "PYTHONPATH": str(checkout / "src")},
        check=True,
        capture_output=True,
        text=True,
    ).stdout


def test_plan_picture_settings_form_and_documents_have_it(checkout: Path) -> None:
    found = json.loads(run(checkout, "-c", LOOK, str(checkout / "docs")).splitlines()[-1])
    assert found["order"].index("dimming") == found["order"].index("acuity") + 1
    assert found["plan"][0] == "on"
    assert found["plan"][1].startswith("0.5 of the light is left: without it, a pixel changes by")
    assert found["changed"] > 0.05
    assert 0 < found["bound"] < 255
    assert found["skipped"] == "skipped"
    assert found["settings"] == 0.25
    assert found["form"] == [["dimming.share", "Light that is left of all.", 0.1, 1.0]]
    assert "### [dimming]" in found["documents"]
    assert "Light that is left of all." in found["documents"]
    assert found["option"] == 0.75
    assert found["left_out"] == ["dimming"]
    assert "dimming" in found["unknown"]
    assert list(found["cost"]) == ["skipped", "half", "a third"]
    assert found["cost"]["skipped"][0] == pytest.approx(1.0)
    assert found["cost"]["half"][0] < 1e-6 < found["cost"]["half"][1]
    assert "dimming" in found["combined"]


def test_a_session_its_report_and_what_explains_it_have_it(checkout: Path) -> None:
    small = ("--seconds", "0.2", "--fps", "10", "--width", "40", "--height", "40")
    run(checkout, "-m", "entoptic", "session", *small, "--settings", "dim.toml", "--out", "seen")
    with (checkout / "seen" / "plan.csv").open(newline="") as stream:
        assert {row["dimming_level"] for row in csv.DictReader(stream)} == {"on"}
    assert "dimming" in (checkout / "seen" / "report.html").read_text()
    run(checkout, "-m", "entoptic", "explain", "seen", "-o", "why.png")
    assert (checkout / "why.png").stat().st_size > 1e4
