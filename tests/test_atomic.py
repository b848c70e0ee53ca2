"""Files that are whole or not there, and what killed writers leave."""

import os
import signal
import subprocess
import sys

import pytest

from ohmward.atomic import back_up, replacing, write_text
from ohmward.errors import OhmwardError

WRITER = """
import sys, time
from pathlib import Path
from ohmward.atomic import replacing
with replacing(Path(sys.argv[1])) as temporary:
    temporary.write_text("half")
    print("written", flush=True)
    time.sleep(60)
"""


def parts(folder):
    return sorted(folder.glob(".*.part"))


@pytest.fixture
def writer(tmp_path):
    """A process in the middle of writing a file."""
    process = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path / "a.csv")], stdout=subprocess.PIPE)
    assert process.stdout is not None and process.stdout.readline() == b"written\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


@pytest.mark.skipif(os.name == "nt", reason="no locks of this kind")
def test_what_a_killed_writer_left_goes_with_the_next_write(tmp_path, writer):
    (tmp_path / ".a.csv.bak.12345678.part").write_text("of another file")
    writer.send_signal(signal.SIGKILL)
    writer.wait()
    assert len(parts(tmp_path)) == 2
    write_text(tmp_path / "a.csv", "whole")
    assert [left.name for left in parts(tmp_path)] == [".a.csv.bak.12345678.part"]
    assert (tmp_path / "a.csv").read_text() == "whole"


def test_a_writer_that_lives_is_not_disturbed(tmp_path, writer):
    (held,) = parts(tmp_path)
    write_text(tmp_path / "a.csv", "whole")
    assert parts(tmp_path) == [held] and held.read_text() == "half"


@pytest.mark.skipif(os.name == "nt", reason="no modes or links of this kind")
def test_a_link_and_the_mode_of_its_file_stay(tmp_path):
    file, link = tmp_path / "there" / "a.toml", tmp_path / "a.toml"
    file.parent.mkdir()
    file.write_text("before")
    file.chmod(0o600)
    link.symlink_to(file)
    write_text(link, "after")
    assert link.is_symlink() and file.read_text() == "after"
    assert file.stat().st_mode & 0o777 == 0o600


@pytest.mark.skipif(os.name == "nt", reason="no modes of this kind")
def test_a_backup_has_the_mode_of_its_file(tmp_path):
    (tmp_path / "a.toml").write_text("secret")
    (tmp_path / "a.toml").chmod(0o600)
    backup = back_up(tmp_path / "a.toml")
    assert backup is not None and backup.stat().st_mode & 0o777 == 0o600


def test_an_error_leaves_the_file_as_it_was(tmp_path):
    write_text(tmp_path / "a.csv", "before")
    with pytest.raises(ValueError, match="broken"), replacing(tmp_path / "a.csv") as temporary:
        temporary.write_text("half")
        raise ValueError("broken")
    assert (tmp_path / "a.csv").read_text() == "before" and not parts(tmp_path)
    with pytest.raises(OhmwardError, match="cannot be written"):
        write_text(tmp_path / "nowhere" / "a.csv", "text")
