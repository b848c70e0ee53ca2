"""Formats of common loggers, compared with the log that was written: read right, or refused with the remedy."""

import pytest

from logs.formats.composed import write
from logs.formats.layouts import PLAIN, table
from logs.formats.population import FORMATS, difference
from ohmward.cli.battery_inputs import read_battery_log, read_options
from ohmward.cli.main import parse
from ohmward.errors import InputError
from ohmward.logs import read_log

AT_ONCE = [about for about in FORMATS if not about.flags]
WITH_A_FLAG = [about for about in FORMATS if about.flags]


def of_name(about):
    return about.name


@pytest.mark.parametrize("about", AT_ONCE, ids=of_name)
def test_it_is_read_right_at_once(about, tmp_path):
    if about.package:
        pytest.importorskip(about.package)
    assert difference(read_log(about.write(tmp_path)), about) == ""


@pytest.mark.parametrize("about", WITH_A_FLAG, ids=of_name)
def test_it_is_refused_with_the_flag_by_which_it_is_read_right(about, tmp_path):
    path = about.write(tmp_path)
    with pytest.raises(InputError, match=about.flags[0]):
        read_log(path)
    arguments = parse(["doctor", str(path), *about.flags])
    assert difference(read_battery_log(str(path), read_options(arguments)), about) == ""


def test_most_formats_need_no_flag():
    assert len(FORMATS) > 100 and len({about.name for about in FORMATS}) == len(FORMATS)
    assert len(WITH_A_FLAG) <= 0.08 * len(FORMATS)


def test_a_file_is_the_same_through_standard_input(tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    path.write_text(table(rows=PLAIN), encoding="utf-8")
    with path.open() as stream:
        monkeypatch.setattr("sys.stdin", stream)
        log = read_log("-")
    assert difference(log, FORMATS[0]) == ""
    assert log.name == "standard input"


def test_a_device_without_an_end_is_refused():
    with pytest.raises(InputError, match=r"/dev/zero is a device, which has no end"):
        read_log("/dev/zero")


@pytest.mark.parametrize("seed", range(60))
def test_a_table_composed_at_random_is_read_right(seed, tmp_path):
    about, path = write(tmp_path, seed)
    assert difference(read_log(path), about) == "", about.name
