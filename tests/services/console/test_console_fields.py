"""Settings as things to move: all of them, with ranges that hold."""

from typing import Annotated

import msgspec
import pytest

from entoptic.services.console.fields import fields, session_fields
from entoptic.services.records import leaves as leaves_of
from entoptic.services.session_config import SessionConfig
from entoptic.services.settings import Settings, changed

NUMBERS = [field for field in fields() if field.kind in ("number", "int")]


def leaves(values: dict[str, object], path: str = "") -> dict[str, object]:
    found = {}
    for name, value in values.items():
        where = f"{path}.{name}" if path else name
        found |= leaves(value, where) if isinstance(value, dict) else {where: value}
    return found


def test_every_setting_is_there_once_with_its_default() -> None:
    defaults = leaves(msgspec.to_builtins(Settings()))
    assert {field.path: field.default for field in fields()} == defaults
    assert len({field.path for field in fields()}) == len(fields())


def test_those_of_lui_come_first() -> None:
    lids = tuple(f"observer.ocular_dynamics.{name}" for name in ("lids", "lashes", "squint", "hippus"))
    tuned = tuple(f"observer.{name}" for name in ("age_years", "iris", "particles", "particle_mm", "defocus_d"))
    assert tuple(field.path for field in fields() if field.first) == (*tuned, *lids, "plan.budget_ms")
    assert [field.first for field in fields()] == sorted((field.first for field in fields()), reverse=True)


def test_sentences_come_from_the_records() -> None:
    by_path = {field.path: field for field in fields()}
    assert "LUI 5.2.4" in by_path["observer.particles"].help
    assert by_path["observer.particle_mm"].label == "Particle, mm"
    assert dict(by_path["glare.level"].options)["quarter"].startswith("Cells of 4")
    assert by_path["plan.budget_ms"].optional
    assert by_path["plan.budget_ms"].low_open
    assert [value for value, _ in by_path["observer.iris"].options] == ["dark", "brown", "green", "blue"]
    assert "glare" in dict(by_path["plan.leave_out"].options)


def test_limits_that_are_not_values_themselves_are_honoured() -> None:
    class Limited(msgspec.Struct):
        whole: Annotated[int, msgspec.Meta(gt=2, lt=8)] = 3
        broken: Annotated[float, msgspec.Meta(gt=0.0, lt=1.0)] = 0.5

    whole, broken = leaves_of(Limited)
    assert (whole.low, whole.high, whole.low_open) == (3, 7, False)
    assert (broken.low, broken.low_open) == (0.0, True)
    assert broken.high is not None
    assert 0.999999 < broken.high < 1.0
    assert next(field for field in fields() if field.path == "rod_noise.seed").high == 2**32 - 1


@pytest.mark.parametrize("field", NUMBERS, ids=lambda field: field.path)
def test_ranges_are_those_of_the_settings(field: object) -> None:
    assert hasattr(field, "path")
    for value in (field.low, field.high, *(field.slider or ())):
        if value is not None and not (value == field.low and field.low_open):
            value = round(value) if field.kind == "int" else value
            assert leaves(msgspec.to_builtins(changed(Settings(), {field.path: value})))[field.path] == value
    for value, beyond in ((field.low, -1), (field.high, 1)):
        if value is not None:
            with pytest.raises(ValueError, match=field.path):
                changed(Settings(), {field.path: value + beyond})
    if field.slider is not None:
        assert field.low <= field.slider[0] < field.slider[1] <= field.high
    if field.log:
        assert (field.slider or (field.low,))[0] > 0


def test_every_choice_can_be_made() -> None:
    for field in fields():
        if field.kind == "choice" and field.path != "tone.operator":
            for value, _ in field.options:
                changed(Settings(), {field.path: value})
    assert {field.path for field in fields() if field.slider} <= {field.path for field in NUMBERS}


def test_changes_leave_the_rest_and_wrong_ones_say_why() -> None:
    old = changed(Settings(), {"observer.ocular_dynamics.lids": True, "glare.level": "half"})
    new = changed(old, {"observer.age_years": 60})
    assert new.observer.ocular_dynamics.lids
    assert new.glare.level == "half"
    assert changed(new, {"observer.seed": 3}, from_defaults=True).observer.age_years == 30
    for changes, said in (
        ({"observer.height": 2}, "no setting 'observer.height'"),
        ({"observer": {}}, "no setting 'observer'"),
        ({"observer.iris": "red"}, "observer.iris"),
        ({"plan.everything": True, "plan.budget_ms": 5.0}, "exclude each other"),
        ({"tone.operator": "curve"}, "names a file"),
        ({"observer.age_years": float("nan")}, "observer.age_years"),
    ):
        with pytest.raises(ValueError, match=said):
            changed(Settings(), changes)


def test_a_session_s_form_has_all_that_a_session_has_beside_its_settings() -> None:
    defaults = leaves(msgspec.to_builtins(SessionConfig()))
    beside = {path: value for path, value in defaults.items() if not path.startswith("settings.")}
    assert {field.path: field.default for field in session_fields()} == beside
    assert all(field.help and field.label for field in session_fields())
    assert [field.first for field in session_fields()] == sorted((f.first for f in session_fields()), reverse=True)
    by_path = {field.path: field for field in session_fields()}
    assert (by_path["eyes.source"].list, by_path["view.scene"].list) == ("sources", "scenes")
    assert (by_path["view.width_px"].low, by_path["view.width_px"].high) == (1, 16384)
    assert by_path["eyes.usb_faults"].kind == "texts"
