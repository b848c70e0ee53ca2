"""What single precision costs: bare filters keep SoC to 2e-5 over a long cycled log, and the page says it of all."""

import numpy as np
import pytest

from needs import needs_gcc
from scripts import script

pytest.importorskip("cffi", reason="pip install cffi for the twin")
measure, precision = script("measure", "firmware"), script("precision", "firmware")

#: Largest difference of SoC. The extended filter has more, for a while, where the slope of the curve jumps.
TOLERANCES = [("coulomb", 1e-5), ("textbook-ukf", 2e-5), ("ukf", 5e-4)]


@pytest.fixture(scope="module")
def battery():
    return measure.battery_and_hour()[0]


def costs_of(battery, name, samples, **options):
    export = measure.battery_export(battery, name, "filter", **options)
    return {row.member: row for row in precision.costs(measure.Case(name, export, samples))}


@needs_gcc
@pytest.mark.parametrize(("name", "tolerance"), TOLERANCES)
def test_soc_is_kept_over_a_long_log(battery, name, tolerance):
    found = costs_of(battery, name, precision.cycled(battery, 20_000))
    assert 0.0 < found["soc"].usual <= found["soc"].difference < tolerance
    assert all(row.unequal_nans == 0 for row in found.values())


@needs_gcc
def test_the_parameters_are_kept_on_a_battery_that_is_the_model(battery):
    found = costs_of(battery, "textbook-joint", precision.cycled_rc(battery, 20_000), style="loops")
    """R_t is the difference of R_0 and R_e / 2, whose errors it has, and C_s of a plateau is large: larger shares."""
    for member, share in (("r_ohm", 0.02), ("r_terminal_ohm", 0.03), ("c_surface_F", 0.04)):
        assert found[member].usual < share * found[member].largest
    assert found["bulk_V"].difference < 5e-3


def test_the_log_takes_the_battery_up_and_down(battery):
    samples = precision.cycled(battery, 30_000)
    soc = 0.9 + np.cumsum(samples.current_A) / (3600.0 * battery.capacity_Ah)
    assert 0.15 < soc.min() < 0.3 and 0.85 < soc.max() < 1.1
    assert np.isfinite(samples.voltage_V).all() and np.ptp(samples.voltage_V) > 0.3


def test_the_page_has_every_filter_and_observer():
    text = precision.PAGE.read_text(encoding="utf-8")
    for name, options in measure.FILTERS:
        title = measure.title_of(name, **options)
        assert (f"| {title} | `" in text) == (options.get("style") != "loops")
    for robot, name, _ in measure.OBSERVERS:
        assert f"| {robot.name} speed, {name} | `speed_m_s` |" in text
