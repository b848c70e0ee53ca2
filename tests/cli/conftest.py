import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cli.examples import write_files
from ohmward.cli.main import main


@pytest.fixture(scope="session")
def files(tmp_path_factory) -> Path:
    """A folder with test.csv, day.csv and battery.toml; nobody writes into it."""
    folder = tmp_path_factory.mktemp("files")
    write_files(folder)
    return folder


@pytest.fixture
def here(files, tmp_path, monkeypatch) -> Path:
    """An empty current folder with links to the files, as a user would sit in it."""
    for file in files.iterdir():
        (tmp_path / file.name).symlink_to(file)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def refused(capsys) -> Callable[..., str]:
    """Run a command line that must be refused; the message and the command that mends it, which is all it may print."""

    def run(*words: str) -> str:
        assert main(words) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith("ohmward: error: ")
        _, *command = err.splitlines()
        assert not command or (len(command) == 1 and command[0].startswith("ohmward: try: ohmward "))
        return err

    return run


@pytest.fixture
def as_json(capsys) -> Callable[..., dict[str, Any]]:
    """Run a command line with --json; its object, which is all that standard output may carry."""

    def run(*words: str) -> dict[str, Any]:
        assert main([*words, "--json"]) in (0, 1)
        out = capsys.readouterr().out
        return json.loads(out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))

    return run
