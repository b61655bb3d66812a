from pathlib import Path

import pytest

from pipeline import Glare, GlareLevel, GlareModel
from services.settings import Settings, SettingsError, load


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
        level = "frame"
        [observer]
        age_years = 61
        [observer.living]
        vitreous = true
        [display]
        peak_cd_m2 = 400
    """,
        )
    )
    assert settings.glare == Glare(GlareModel.SPE, GlareLevel.FRAME)
    assert settings.observer.living.vitreous
    assert not settings.observer.living.lids
    assert settings.observer.age_years == 61
    assert settings.observer.particles == Settings().observer.particles
    assert settings.display.peak_cd_m2 == 400


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[observer]\nagee_years = 3\n", "agee_years"),
        ("[observer]\nage_years = -3\n", r"observer\.age_years"),
        ("[observer]\nparticles = 1.5\n", r"observer\.particles"),
        ("[glare]\nmodel = 'bloom'\n", "bloom"),
        ("[observer.living]\nlegs = true\n", r"legs.*observer\.living"),
        ("[screen]\n", "screen"),
        ("[observer\n", "observer.toml"),
        ("\x00", "observer.toml"),
    ],
)
def test_a_bad_file_is_named_with_its_key_and_what_it_may_hold(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(SettingsError, match=named) as error:
        load(written(tmp_path, text))
    assert "It may hold [adaptation] target" in str(error.value)


def test_a_missing_file_is_named() -> None:
    with pytest.raises(SettingsError, match=r"nowhere\.toml"):
        load(Path("nowhere.toml"))
