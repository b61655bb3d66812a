import runpy
import tomllib
from pathlib import Path

from entoptic.services.settings import load

SCRIPT = Path(__file__).parents[2] / "docs" / "observer_file.py"


def test_the_page_on_the_observer_file_says_what_the_records_say() -> None:
    script = runpy.run_path(str(SCRIPT))
    assert script["page"]() == script["PAGE"].read_text(encoding="utf-8"), "out of date: make docs"


def test_its_example_is_a_settings_file(tmp_path: Path) -> None:
    example = SCRIPT.with_name("observer-file.md").read_text(encoding="utf-8").split("```toml\n")[1].split("```")[0]
    path = tmp_path / "my_eye.toml"
    path.write_text(example, encoding="utf-8")
    assert load(path).observer.age_years == tomllib.loads(example)["observer"]["age_years"]
