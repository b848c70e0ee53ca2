"""Every name of `import ohmward as ow` has an example in its docstring, and each of them runs and says what it says."""

import doctest
import shutil

import numpy as np
import pytest

import ohmward as ow
from markdown_pages import ROOT
from ohmward.cli.main import main

OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def examples_of(name: str) -> list[doctest.DocTest]:
    found = doctest.DocTestFinder(recurse=False).find(getattr(ow, name), name, module=False, globs={})
    return [test for test in found if test.examples]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The files that the examples speak of: a pulse test, two days, a drive, and what was found from them."""
    folder = tmp_path_factory.mktemp("examples")
    day = ow.make_robot_day("lfp")
    ow.write_log(day.pulse_test, folder / "test.csv")
    ow.write_log(day.mission, folder / "day.csv")
    ow.write_log(ow.make_robot_day("lfp", seed=2).mission, folder / "next-day.csv")
    battery, drive, table = (str(folder / name) for name in ("battery.toml", "drive.csv", "table.toml"))
    ow.save_battery(ow.identify(day.pulse_test, capacity_Ah=12, chemistry="lfp", n_series=4), battery)
    onto_ice = (ROOT / "lab/ohmward_lab/simulate/scenarios/onto-ice.toml").read_text(encoding="utf-8")
    short = onto_ice.replace("duration_s = 10.0", "duration_s = 4.0").replace("from_s = 5.0", "from_s = 2.0")
    (folder / "onto-ice.toml").write_text(short, encoding="utf-8")
    assert main(["simulate", str(folder / "onto-ice.toml"), "-o", drive]) == 0
    options = ("--battery", battery, "--current-sign", "charge", "--terrain", "grass")
    assert main(["mission", drive, "--robot", "rlma", *options, "-o", table]) == 0
    ow.save_robot(ow.load_robot("turtlebot4"), folder / "robot.toml")
    return folder


@pytest.mark.parametrize("name", ow.__all__)
def test_the_example_runs(name, files, tmp_path, monkeypatch, capsys):
    shutil.copytree(files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    tests = examples_of(name)
    assert tests, f"ohmward.{name} needs an example in its docstring"
    runner = doctest.DocTestRunner(optionflags=OPTIONS)
    for test in tests:
        test.globs |= {"ow": ow, "np": np}
        runner.run(test)
    assert not runner.failures, capsys.readouterr().out
