import re
from pathlib import Path

import pytest

from entoptic.pipeline import Glare, GlareLevel, GlareModel
from entoptic.services.settings import Settings, SettingsError, load


def written(folder: Path, text: str) -> Path:
    path = folder / "observer.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_no_file_is_the_defaults() -> None:
    assert load(None) == Settings()


def test_a_file_sets_what_it_names(tmp_path: Path) -> None:
    settings = load(
        written(
            tmp_path,
            """
        [glare]
        model = "spe"
        level = "half"
        [observer]
        age_years = 61
        [observer.ocular_dynamics]
        vitreous = true
        [display]
        peak_cd_m2 = 400
    """,
        )
    )
    assert settings.glare == Glare(GlareModel.SPE, GlareLevel.HALF)
    assert settings.observer.ocular_dynamics.vitreous
    assert not settings.observer.ocular_dynamics.lids
    assert settings.observer.age_years == 61
    assert settings.observer.particles == Settings().observer.particles
    assert settings.display.peak_cd_m2 == 400


@pytest.mark.parametrize(
    ("text", "named", "may_hold"),
    [
        ("[observer]\nagee_years = 3\n", "agee_years", r"\[observer\] may hold age_years, iris"),
        ("[observer]\nage_years = -3\n", r"observer\.age_years", r"\[observer\] may hold age_years"),
        ("[observer]\nparticles = 1.5\n", r"observer\.particles", r"\[observer\] may hold age_years"),
        ("[glare]\nmodel = 'bloom'\n", "bloom", "model may be wave, spe"),
        ("[plan]\nleave_out = ['sun']\n", "sun", r"\[plan\] may hold everything, leave_out"),
        (
            "[observer.ocular_dynamics]\nlegs = true\n",
            r"legs.*observer\.ocular_dynamics",
            r"\[observer\.ocular_dynamics\] may hold micro",
        ),
        ("[screen]\n", "screen", "Its tables may be adaptation, glare"),
        ("[observer\n", "observer.toml", "Its tables may be adaptation"),
        ("\x00", "observer.toml", "Its tables may be adaptation"),
    ],
)
def test_a_bad_file_is_named_with_its_key_and_what_it_may_hold_there(
    tmp_path: Path, text: str, named: str, may_hold: str
) -> None:
    with pytest.raises(SettingsError, match=named) as error:
        load(written(tmp_path, text))
    assert re.search(may_hold + "[^;[]*$", str(error.value))


def test_a_missing_file_is_named() -> None:
    with pytest.raises(SettingsError, match=r"nowhere\.toml"):
        load(Path("nowhere.toml"))
