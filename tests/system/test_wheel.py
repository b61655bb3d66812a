"""What `pip install` puts into an environment, built here with the build backend itself, without a network."""

import tarfile
import zipfile
from pathlib import Path

import hatchling.build
import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("pipeline", "services", "tracker_bridge")


def in_the_checkout() -> set[str]:
    """What a wheel has to hold: code, pages, templates, tables."""
    of_package = [path for package in PACKAGES for path in (ROOT / package).rglob("*")]
    files = {f"entoptic/{path.relative_to(ROOT).as_posix()}" for path in of_package if path.is_file()}
    files |= {f"entoptic/{path.name}" for path in (ROOT / "src" / "entoptic").iterdir() if path.is_file()}
    return {name for name in files if "__pycache__" not in name}


def in_wheel(folder: Path) -> set[str]:
    with zipfile.ZipFile(folder / hatchling.build.build_wheel(str(folder))) as wheel:
        return {name for name in wheel.namelist() if ".dist-info/" not in name}


def test_a_wheel_holds_the_checkouts_packages_under_one_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    held = in_wheel(tmp_path)
    assert {name.partition("/")[0] for name in held} == {"entoptic"}
    assert held == in_the_checkout()
    assert {Path(name).suffix for name in held} >= {".py", ".html", ".js", ".css", ".svg", ".jinja", ".toml", ".typed"}


def test_the_source_archive_has_no_links_and_makes_the_same_wheel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    with tarfile.open(tmp_path / hatchling.build.build_sdist(str(tmp_path))) as archive:
        # Windows makes links for developers alone.
        assert all(member.isfile() for member in archive.getmembers())
        archive.extractall(tmp_path, filter="data")
    (source,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert (source / "LICENSE").exists()
    monkeypatch.chdir(source)
    assert in_wheel(tmp_path) == in_the_checkout()
