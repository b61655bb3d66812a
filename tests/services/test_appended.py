"""Files that grow by whole records, whatever becomes of the disk, of the folder and of who writes them."""

import csv
import subprocess
import sys
from pathlib import Path

import pytest

from entoptic.services.results.appended import Appended, row, whole_rows


def test_each_record_is_in_the_file_as_soon_as_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with Appended(path) as file:
        assert file.size == 0
        file.write(b"one,")
        assert path.read_bytes() == b"one,"
        file.write(b"two,")
        assert path.read_bytes() == b"one,two,"
        assert file.size == 8
    assert path.stat().st_mode & 0o600 == 0o600


def test_one_that_is_opened_again_goes_on_at_its_end(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"one,")
    with Appended(path) as file:
        assert file.size == 4
        file.write(b"two,")
    assert path.read_bytes() == b"one,two,"


@pytest.mark.parametrize(
    ("whole_bytes", "left"), [(0, b""), (4, b"one,"), (8, b"one,two,"), (11, b"one,two,thr"), (99, b"one,two,thr")]
)
def test_what_a_killed_writer_left_behind_its_whole_records_is_cut_off(
    tmp_path: Path, whole_bytes: int, left: bytes
) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"one,two,thr")
    with Appended(path, whole_bytes) as file:
        assert file.size == len(left)
        assert path.read_bytes() == left
        file.write(b"three,")
    assert path.read_bytes() == left + b"three,"


LIMITED = """
import resource, signal, sys
from pathlib import Path
from entoptic.services.results.appended import Appended
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10))
path = Path(sys.argv[1])
with Appended(path) as file:
    file.write(b"1234567,")
    try:
        file.write(b"1234567,")
    except OSError as error:
        print(error.strerror, file.size, path.read_bytes())
    file.write(b"8,")
"""


def test_a_record_that_does_not_fit_is_taken_back_and_a_smaller_one_still_fits(tmp_path: Path) -> None:
    path = tmp_path / "a"
    done = subprocess.run([sys.executable, "-c", LIMITED, str(path)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "File too large 8 b'1234567,'\n"
    assert path.read_bytes() == b"1234567,8,"


def test_a_file_that_was_deleted_moved_or_replaced_is_noticed(tmp_path: Path) -> None:
    for name in ("deleted", "moved", "replaced"):
        path = tmp_path / name
        with Appended(path) as file:
            file.check()
            if name == "moved":
                path.rename(tmp_path / "elsewhere")
            else:
                path.unlink()
            if name == "replaced":
                path.write_bytes(b"another's")
            file.write(b"into nowhere")
            with pytest.raises(FileNotFoundError, match="deleted or moved") as caught:
                file.check()
            assert caught.value.filename == str(path)


def test_a_closed_file_is_written_to_no_more(tmp_path: Path) -> None:
    with Appended(tmp_path / "a") as file:
        pass
    with pytest.raises(OSError, match="Bad file descriptor"):
        file.write(b"late")


def test_a_row_is_one_line_of_a_table_whatever_its_cells_hold(tmp_path: Path) -> None:
    cells = ["plain", 'with "quotes", and commas', "two\nlines", 1.5, ""]
    path = tmp_path / "a.csv"
    path.write_bytes(row(cells))
    with path.open(newline="") as file:
        assert list(csv.reader(file)) == [[str(cell) for cell in cells]]
    assert whole_rows(path) == len(row(cells))


@pytest.mark.parametrize(
    ("text", "whole"),
    [(b"", 0), (b"1,2", 0), (b"1,2\n", 4), (b"1,2\n3,", 4), (b"1,2\r\n3,4\r\n", 10), (b"1\n" * 50_000 + b"2", 100_000)],
)
def test_a_table_is_whole_up_to_its_last_line_end(tmp_path: Path, text: bytes, whole: int) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(text)
    assert whole_rows(path) == whole
    assert whole_rows(tmp_path / "none.csv") == 0
