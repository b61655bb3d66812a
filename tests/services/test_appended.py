import resource
import subprocess
import sys
from pathlib import Path

import pytest

from entoptic.services.results.appended import Appended


def test_it_grows_by_whole_records_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with Appended(path) as file:
        file.write(b"one,")
        assert path.read_bytes() == b"one,"
        file.write(b"two,")
    with path.open("ab") as torn:
        torn.write(b"thr")
    with Appended(path, whole_bytes=8) as file:
        assert file.size == 8
        file.write(b"three,")
    assert path.read_bytes() == b"one,two,three,"


LIMITED = """
import resource, signal, sys
from pathlib import Path
from entoptic.services.results.appended import Appended
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))
with Appended(Path(sys.argv[1])) as file:
    file.write(b"1234567,")
    try:
        file.write(b"1234567,")
    except OSError:
        print("full", file.size)
"""


def test_a_record_that_does_not_fit_is_taken_back(tmp_path: Path) -> None:
    assert resource.RLIMIT_FSIZE is not None
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, str(tmp_path / "a")], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "full 8\n"
    assert (tmp_path / "a").read_bytes() == b"1234567,"


def test_a_deleted_file_is_noticed(tmp_path: Path) -> None:
    with Appended(tmp_path / "a") as file:
        file.check()
        (tmp_path / "a").unlink()
        file.write(b"into nowhere")
        with pytest.raises(FileNotFoundError, match="deleted or moved"):
            file.check()
