"""Arguments of a wrong kind: each public function names the argument and what it should be."""

from typing import Any

import numpy as np
import pytest

import ohmward

ow: Any = ohmward  # types are wrong on purpose
LOG = ow.Log("day", np.arange(50.0), np.full(50, -1.0), np.full(50, 3.3))
BATTERY = ow.generic_battery("lfp", 20)


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    path = tmp_path_factory.mktemp("wrong") / "day.csv"
    ow.write_log(LOG, path)
    return path


CALLS = {
    "columns must be a dict": lambda day: ow.read_log(day, columns=["current"]),
    "units must be a dict": lambda day: ow.read_drive(day, ("left", "right"), 2, units="rpm"),
    "where must be a dict": lambda day: ow.read_log(day, where=5),
    "capacity_Ah must be a number, got '20'": lambda day: ow.generic_battery("lfp", "20"),
    "cells in series must be a number, got '4'": lambda day: ow.generic_battery("lfp", 20, n_series="4"),
    "chemistry must be the name of one": lambda day: ow.generic_battery(5, 20),
    "capacity_Ah must be a number, got '2'": lambda day: ow.identify(LOG, capacity_Ah="2"),
    "initial_soc of 'day' must be a number": lambda day: ow.identify(LOG, capacity_Ah=2.0, initial_soc="full"),
    "the path of a file must be text": lambda day: ow.load_battery(5),
    "a file must be text or a Path, got None": lambda day: ow.save_battery(BATTERY, None),
    "a Path, got 7": lambda day: ow.write_log(LOG, 7),
    "columns must be a dict, such as": lambda day: ow.write_table([1.0], day),
    "column 'soc' has the shape": lambda day: ow.write_table({"soc": 0.5}, day),
    "truth must be a share, between 0 and 1, got 60": lambda day: ow.compare(BATTERY, LOG, truth=np.full(50, 60.0)),
    "filter must be one of .*, got 'ekff'": lambda day: ow.compare(BATTERY, LOG, "ekff"),
    "new_capacity_Ah must be a number, got '20'": lambda day: ow.health(BATTERY, LOG, new_capacity_Ah="20"),
    "the time of a sample must be a number": lambda day: LOG.between("noon", 40.0),
    r"as of load_robot\('husky'\)": lambda day: ow.read_drive(day, "husky"),
    "truth must be an array of numbers": lambda day: ow.score([0.5], "soc_true"),
    "truth must be an array": lambda day: ow.plot(ow.SocEstimator(BATTERY, filter="coulomb").run(LOG), truth="soc"),
}


@pytest.mark.parametrize("message", CALLS)
def test_an_argument_of_a_wrong_kind_is_named(message, day):
    with pytest.raises(ow.InputError, match=message):
        CALLS[message](day)


def test_lists_are_as_good_as_arrays_for_a_score():
    assert ow.score([0.5, 0.6], [0.5, 0.5], 0.1).rmse == pytest.approx(np.sqrt(0.005))
