from dataclasses import replace

import numpy as np
import pytest

from energy.examples import PRIOR, learned
from ohmward.energy.consumption import begin_drive, learn, start
from ohmward.energy.consumption_file import dump_consumption, load_consumption, parse_consumption, save_consumption
from ohmward.energy.leg import Leg, stretch_of
from ohmward.errors import InputError


def test_learning_goes_on_to_the_bit(tmp_path):
    c = learn(learned(), stretch_of(Leg(40.0, "grass", 0.5)), 1500.0)
    save_consumption(replace(c, last_drive_unix_s=1.7e9), tmp_path / "table.toml")
    back = load_consumption(tmp_path / "table.toml")
    assert back.last_drive_unix_s == 1.7e9
    for a, b in ((c, back), (begin_drive(c, 3.0), begin_drive(back, 3.0))):
        assert np.array_equal(a.mean, b.mean) and np.array_equal(a.cov, b.cov)
        for name in ("scatter", "day", "idle_noise", "visits", "on_this_drive"):
            assert getattr(a, name) == getattr(b, name), name
        assert (a.prior, a.terrains, a.reference_N) == (b.prior, b.terrains, b.reference_N)


def test_a_table_of_before_the_noise_of_the_idle_power_has_that_of_its_prior():
    text = dump_consumption(learned())
    table, _, others = text.partition("[idle_noise]")
    back = parse_consumption(table + others[others.index("[") :])
    assert back.idle_noise == start(PRIOR).idle_noise


def test_people_can_read_it():
    text = dump_consumption(learned())
    assert "#   grass: resistance" in text and "J/m measured" in text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("ohmward-consumption/1", "ohmward-consumption/9"), "format must be"),
        (("[coefficients]", "[coefficient]"), "coefficient is not a key"),
        (("drives = 3", 'trips = "three"'), "the key drives is missing"),
        (("mass_kg = 40.0", "mass_kg = -4.0"), "prior.mass_kg must be > 0"),
        (("mass_kg = 40.0", "mass = 40.0"), "another kind"),
        (('name = "grass"', 'name = "lawn"'), "coefficients.names"),
        (("format =", "format "), "not valid TOML"),
    ],
)
def test_what_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        parse_consumption(dump_consumption(learned()).replace(*change))


def test_a_file_that_is_none(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_consumption(tmp_path / "none.toml")
