"""The scenario file, and the scenarios that come with the package."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from importlib.resources.abc import Traversable
from os import PathLike
from pathlib import Path

from ohmward.errors import InputError
from ohmward.toml_file import TomlFile
from ohmward_lab.simulate.closed_loop.scenario import Scenario

_HEADER = """\
# A drive for `ohmward simulate`. Every key carries its unit; what is left out has a default, and
# `ohmward simulate --example` prints all keys with what they mean.
"""
_FILE = TomlFile(Scenario, "ohmward-scenario/1", _HEADER, digits=12, paths=("robot", "battery.file"))
#: The packaged scenario that shows every key.
EXAMPLE = "example"


def load_scenario(path: str | PathLike[str]) -> Scenario:
    """The scenario in a file; paths of robot and battery files in it are taken from its folder.

    Raises:
        InputError: the file cannot be read or has an impossible value; names file, key, rule and fix.
    """
    scenario = _FILE.load(path)
    return scenario if scenario.name else replace(scenario, name=Path(path).stem)


def save_scenario(scenario: Scenario, path: str | PathLike[str]) -> None:
    """Write the scenario file; it is either whole or not there. Paths in it count from its folder when it is read.

    Raises:
        OhmwardError: the file cannot be written.
    """
    _FILE.save(scenario, path)


def parse_scenario(text: str) -> Scenario:
    """The scenario in the text of a scenario file.

    Raises:
        InputError: as `load_scenario`.
    """
    return _FILE.parse(text)


def packaged() -> Mapping[str, str]:
    """The scenarios that come with the package: name -> its first line."""
    texts = {file.name.removesuffix(".toml"): file.read_text(encoding="utf-8") for file in _folder()}
    return {name: text.partition("\n")[0].lstrip("# ") for name, text in sorted(texts.items())}


def packaged_text(name: str) -> str:
    """The file of a packaged scenario.

    Raises:
        InputError: there is none of that name.
    """
    for file in _folder():
        if file.name == f"{name}.toml":
            return file.read_text(encoding="utf-8")
    raise InputError(f"{name}: no such file, and no scenario of that name; there are: {', '.join(packaged())}")


def find_scenario(name: str) -> Scenario:
    """The scenario in a file, or the packaged one of this name.

    Raises:
        InputError: as `load_scenario` and `packaged_text`.
    """
    if Path(name).is_file() or name.endswith(".toml"):
        return load_scenario(name)
    scenario = parse_scenario(packaged_text(name))
    return scenario if scenario.name else replace(scenario, name=name)


def _folder() -> list[Traversable]:
    folder = files("ohmward_lab.simulate").joinpath("scenarios")
    return [file for file in folder.iterdir() if file.name.endswith(".toml")]
