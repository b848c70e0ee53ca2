"""Every public function that takes a log takes its path, or a DataFrame, as well."""

from pathlib import Path

import numpy as np
import pytest

import ohmward as ow
from ohmward.battery.learning.learn import learn
from ohmward.traction import RLMA
from ohmward.traction.odometry.estimator import Odometry

BATTERY = ow.generic_battery("lfp", 12.0, n_series=4)
DOORS = {
    "examine": ow.examine,
    "write_log": lambda log: ow.write_log(log, "out.csv"),
    "identify": lambda log: ow.identify(log, capacity_Ah=3.0),
    "identify of several": lambda log: ow.identify([log], capacity_Ah=3.0),
    "learn": lambda log: learn(BATTERY, log),
    "learn of several": lambda log: learn(BATTERY, [log]),
    "SocEstimator": lambda log: ow.SocEstimator(BATTERY, filter="coulomb").run(log),
    "PackEstimator": lambda log: ow.PackEstimator(BATTERY).run(log),
    "RangeEstimator": lambda log: ow.RangeEstimator(BATTERY, "rlma").run(log, np.ones(1)),
    "SlipEstimator": lambda log: ow.SlipEstimator(RLMA).run(log),
    "Odometry": lambda log: Odometry(RLMA).run(log),
    "calibrate": lambda log: ow.calibrate(log, "rlma"),
    "calibrate of several": lambda log: ow.calibrate([log], RLMA),
}


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize("as_path", [str, Path])
def test_a_path_is_read(tmp_path, door, as_path):
    with pytest.raises(ow.InputError, match=r"nothing.csv: there is no such file; check the path"):
        DOORS[door](as_path(tmp_path / "nothing.csv"))


@pytest.mark.parametrize("door", DOORS)
def test_anything_else_is_refused_with_what_is_taken(door):
    with pytest.raises(
        ow.InputError, match=r"the source of a log must be the path of a .* a DataFrame, or a dict of columns"
    ):
        DOORS[door](3.0)


def test_the_estimates_along_a_path_and_a_frame_are_those_of_the_log(tmp_path):
    pandas = pytest.importorskip("pandas")
    log = ow.make_robot_day("lfp").mission.between(3000.0, 3300.0)
    ow.write_log(log, tmp_path / "day.csv")
    expected = ow.SocEstimator(BATTERY, filter="coulomb").run(log).estimates.soc
    for source in (str(tmp_path / "day.csv"), pandas.read_csv(tmp_path / "day.csv")):
        found = ow.SocEstimator(BATTERY, filter="coulomb").run(source).estimates.soc
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "door",
    [
        ow.SocEstimator,
        ow.PackEstimator,
        lambda battery: ow.RangeEstimator(battery, "rlma"),
        lambda battery: ow.make_estimator("ekf", battery),
        lambda battery: ow.save_battery(battery, "out.toml"),
        lambda battery: learn(battery, "day.csv"),
    ],
)
def test_the_path_of_a_battery_in_place_of_the_battery_is_refused_with_what_reads_it(door):
    with pytest.raises(ow.InputError, match=r"battery must be a Battery.*got str; load_battery\(path\) reads one"):
        door("battery.toml")
