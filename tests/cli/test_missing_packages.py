"""A command whose package is missing ends in one line that names what to install."""

import sys

import pytest

from cli.examples import SLIP
from ohmward.cli.main import main

SOC = ("--battery", "battery.toml")


@pytest.mark.parametrize(
    ("package", "words", "message"),
    [
        ("scipy", ("identify", "test.csv", "--capacity-ah", "12"), "identification needs scipy"),
        ("msgspec", ("soc", "day.csv", *SOC), "reading TOML needs msgspec"),
        (
            "tomli_w",
            ("generic", "--chemistry", "lfp", "--capacity-ah", "1", "-o", "b.toml"),
            "writing TOML needs tomli-w",
        ),
        ("pyarrow", ("doctor", "day.parquet"), "Parquet needs pyarrow"),
        ("cffi", ("twin", "library", "day.csv"), "the twin needs cffi"),
        ("mujoco", ("simulate", "mujoco.toml"), "this plant needs mujoco"),
        ("distributed", ("fleet", "day.csv", *SOC, "-o", "out", "--dask", "tcp://x"), "--dask needs distributed"),
    ],
)
def test_it_is_named(package, words, message, here, refused, monkeypatch, capsys):
    (here / "day.parquet").write_bytes(b"PAR1")
    (here / "mujoco.toml").write_text(SLIP.replace("duration_s", 'plant = "mujoco"\nduration_s'))
    assert main(["export", "battery.toml", "--filter", "coulomb", "-o", "library"]) == 0
    capsys.readouterr()
    monkeypatch.setitem(sys.modules, package, None)
    on_the_index = package.replace("_", "-")
    assert f"{message}, which is not installed: pip install {on_the_index}\n" in refused(*words)
