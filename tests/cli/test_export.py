"""`ohmward export` by hand: files, figures, refusals."""

import json

import pytest

from ohmward.battery.battery_file import save_battery
from ohmward.battery.chemistries import generic_battery
from ohmward.cli.main import main


@pytest.fixture
def battery(tmp_path):
    save_battery(generic_battery("nmc", 2.0), tmp_path / "cell.toml")
    return tmp_path / "cell.toml"


def test_it_writes_a_library_and_says_what_it_takes(battery, tmp_path, capsys):
    out = tmp_path / "made" / "soc"
    assert main(["export", str(battery), "--filter", "textbook-ekf", "--name", "cell", "-o", str(out), "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert sorted(p.name for p in out.iterdir()) == sorted(figures["files"])
    assert {"cell.c", "cell.h", "cell_vectors.h", "test_cell.c", "Makefile", "CMakeLists.txt", "README.md"} == set(
        figures["files"]
    )
    assert figures["state_bytes"] == 4 * (3 + 6 + 1) and 2000 < figures["flash_bytes_estimated"] < 10_000
    assert "@" not in (out / "README.md").read_text()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--filter", "kalman"], "filter must be one of"),
        (["--name", "My Filter"], "name must be small letters"),
        (["--flash-kb", "2"], "more than the 2048 there are"),
        (["--initial-soc", "80"], "0 to 1|between 0 and 1"),
    ],
)
def test_refusals_write_nothing(battery, tmp_path, capsys, options, message):
    import re

    assert main(["export", str(battery), "-o", str(tmp_path / "out"), *options]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert not (tmp_path / "out").exists()
