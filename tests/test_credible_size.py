import pytest

from ohmward import generic_battery
from ohmward.battery.file import BATTERY_FILE
from ohmward.checks import LARGEST, require_credible
from ohmward.errors import InputError


@pytest.mark.parametrize("unit", LARGEST)
def test_each_unit_has_its_size(unit):
    require_credible("a" + unit, LARGEST[unit])
    require_credible("a" + unit, [[-LARGEST[unit], 0.0], [1]])
    with pytest.raises(InputError, match=f"a{unit} must be between"):
        require_credible("a" + unit, [[0.0], [-1.01 * LARGEST[unit]]])


def test_the_longer_unit_is_meant():
    require_credible("activation_K", 1000.0)
    with pytest.raises(InputError):
        require_credible("ocv.entropy_V_per_K", 1000.0)


def test_what_is_no_number_is_left_to_others():
    odd: list[object] = [float("nan"), float("inf"), "x", None, True, {}, ["x", None]]
    for value in odd:
        require_credible("tau_s", value)


@pytest.mark.parametrize("key", ["capacity_Ah", "voltage_max_V", "offset_std_A", "resistance_std"])
def test_a_battery_file_names_the_key(key):
    text = BATTERY_FILE.dump(generic_battery("lfp", 12.0, 4))
    lines = [f"{key} = 1e298" if line.startswith(f"{key} = ") else line for line in text.split("\n")]
    with pytest.raises(InputError, match=f"{key} must be between .*, got 1e.298; correct it"):
        BATTERY_FILE.parse("\n".join(lines))


@pytest.mark.parametrize("place", ["thevenin.tau_s", "noise.overpotential_share"])
def test_a_number_too_long_for_a_float_is_refused(place):
    with pytest.raises(InputError, match=f"{place} must be below 1.8e\\+308, got a longer number"):
        require_credible(place, [1.0, 10**400])
