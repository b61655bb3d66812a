"""A session's folder as small as can be, and a frame that was explained."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from entoptic.pipeline import EFFECTS, EyePose, Frame
from entoptic.pipeline.sinks.images import write_exr
from entoptic.services.explain.subject import Subject
from entoptic.services.explain.variants import Explained, explain
from entoptic.services.settings import Settings

WIDTH, HEIGHT, FOV_DEG = 40, 48, 60.0


@pytest.fixture(scope="session")
def lamp() -> np.ndarray:
    """(y, x, 3) cd/m²: left a lit wall with a lamp, right fine stripes that only a day's eye resolves."""
    image = np.full((HEIGHT, WIDTH, 3), 2.0, np.float32)
    image[10:12, 8:10] = 3000.0
    image[:, 24:] = np.where(np.arange(WIDTH - 24) % 2, 0.02, 0.004)[None, :, None]
    return image


@pytest.fixture(scope="session")
def subject(lamp: np.ndarray) -> Subject:
    frame = Frame.from_rgb(lamp, FOV_DEG)
    return Subject("a lamp", frame, (EyePose(5.0, -3.0, 5.0),), Settings(), (0.3,))


@pytest.fixture(scope="session")
def explained(subject: Subject) -> Explained:
    return explain(subject)


@pytest.fixture
def session(tmp_path: Path, lamp: np.ndarray) -> Path:
    """Ten frames of two eyes, key frames 3 and 7; acuity changes its level at frame 4 and back at frame 8."""
    folder = tmp_path / "walk"
    (folder / "key_frames").mkdir(parents=True)
    rows = []
    for k in range(10):
        row: dict[str, object] = {"frame": k, "t_s": f"{k / 10:.6f}"}
        for j, eye in enumerate(("left", "right")):
            row |= {f"{eye}_pupil_diameter_mm": 4.0 + j, f"{eye}_gaze_x_px": 20.0 + 5 * j, f"{eye}_gaze_y_px": 20.0 - k}
            row |= {f"{eye}_adapted_cd_m2": 0.5 + j}
        for effect in EFFECTS:
            runs = effect.name != "acuity" or not 4 <= k < 8
            row |= {
                f"{effect.name}_level": "on" if runs else "skipped",
                f"{effect.name}_reason": f"why {effect.name} at {k}",
                f"{effect.name}_ms": 2.0 * runs,
            }
        rows.append(row | {"scene_ms": 500.0, "measure_ms": 1.0, "total_ms": 999.0})
    with (folder / "plan.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    key_frames = [{"frame": number, "t_s": number / 10} for number in (3, 7)]
    (folder / "key_frames" / "key_frames.json").write_text(json.dumps(key_frames), encoding="utf-8")
    for number in (3, 7):
        image = lamp * number
        write_exr(folder / "key_frames" / f"{number:06d}_scene.exr", np.concatenate([image, image / 2], axis=1))
    view = {"width_px": WIDTH, "height_px": HEIGHT, "fov_deg": FOV_DEG}
    summary = {"config": {"view": view, "settings": {"observer": {"age_years": 61.0}}}}
    (folder / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    return folder
