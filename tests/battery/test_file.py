import re
import tomllib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ohmward import generic_battery
from ohmward.battery.battery import Battery, ConfidenceInterval, LogFit, Provenance
from ohmward.battery.file import BATTERY_FILE, load_battery, replace_battery, save_battery
from ohmward.battery.models.noise import BatteryNoise, CurrentSensor
from ohmward.battery.models.ocv import OcvCurve
from ohmward.battery.models.thevenin import Thevenin
from ohmward.errors import InputError, OhmwardError

OCV = OcvCurve((12.0, 13.2, 14.1), (0.01, 0.0, 0.0), (0.0, 1e-4, 2e-4), 20.0)
THEVENIN = Thevenin(2.0, OCV, (0.05, 0.04), (0.05, 0.04), ((0.01, 0.02), (0.03, 0.01)), (10.0, 500.0))
PROVENANCE = Provenance(
    2.0,
    2.03,
    (LogFit("a", "pulses", 0.1, 1.0, 0.003, 0.02), LogFit("b", "low-rate charge", 0.0, 1.0)),
    (ConfidenceInterval("tau1_s", 10.0, 8.0, 12.0),),
    ("info: something", 'warning: "quoted", back\\slash, µ'),
)
FULL = Battery(
    "cell A",
    2.0,
    "lfp",
    4,
    8.0,
    14.6,
    -0.12,
    BatteryNoise(),
    CurrentSensor(offset_std_A=0.1),
    PROVENANCE,
    ("hysteresis: none seen",),
    thevenin=THEVENIN,
)
PLAIN = Battery("plain", 2.0, thevenin=THEVENIN)
ALONG_SOC = replace(FULL, noise=BatteryNoise(overpotential_share=(0.1, 0.5)))


@pytest.mark.parametrize("battery", [FULL, PLAIN, ALONG_SOC])
def test_round_trip(battery, tmp_path):
    save_battery(battery, tmp_path / "battery.toml")
    assert load_battery(tmp_path / "battery.toml") == battery


positive = st.floats(1e-9, 1e9)
volts = st.floats(0.0, 1e3)


@st.composite
def batteries(draw):
    points = draw(st.integers(2, 30))
    curve = np.cumsum(draw(st.lists(volts, min_size=points, max_size=points)))
    grid = draw(st.integers(2, 25))
    row = st.lists(st.floats(0.0, 1e3), min_size=grid, max_size=grid).map(tuple)
    pairs = draw(st.integers(0, 3))
    tau_s = tuple(float(10.0 ** (2 * j) * draw(st.floats(1.0, 50.0))) for j in range(pairs))
    p = Thevenin(
        draw(positive),
        OcvCurve(tuple(curve.tolist())),
        draw(row),
        draw(row),
        tuple(draw(row) for _ in range(pairs)),
        tau_s,
        activation_K=draw(st.floats(-1e4, 1e4)),
        pair_activation_K=draw(st.none() | st.floats(-1e4, 1e4)),
        tau_activation_K=draw(st.floats(-1e4, 1e4)),
        transfer_V=draw(st.none() | positive),
        empty_activation_K=draw(st.floats(-1e4, 1e4)),
    )
    name = draw(st.text(st.characters(codec="utf-8"), max_size=30))
    return Battery(name, p.capacity_Ah, thevenin=p, not_identified=(name,), noise=BatteryNoise(model_std_V=draw(row)))


@given(batteries())
@settings(max_examples=60)
def test_what_was_rounded_once_stays_as_it_is(battery):
    text = BATTERY_FILE.dump(battery)
    again = BATTERY_FILE.parse(text)
    assert BATTERY_FILE.dump(again) == text
    assert again.name == battery.name
    assert again.thevenin.tau_s == pytest.approx(battery.thevenin.tau_s, rel=1e-5)
    assert again.thevenin.ocv.voltage_V == pytest.approx(battery.thevenin.ocv.voltage_V, rel=1e-5, abs=1e-12)


def test_it_reads_like_a_document():
    text = BATTERY_FILE.dump(FULL)
    assert text.startswith("# A battery as ohmward knows it.")
    assert 'format = "ohmward-battery/3"' in text.splitlines()[4:6]
    assert "[thevenin.ocv]" in text and "[[identification.logs]]" in text and "[noise]" in text
    assert max(map(len, text.splitlines())) <= 140
    assert tomllib.loads(text)["thevenin"]["tau_s"] == [10.0, 500.0]


def edited(old, new):
    text = BATTERY_FILE.dump(FULL)
    assert old in text
    return text.replace(old, new, 1)


def test_a_hand_edit_is_taken():
    text = edited("idle_current_A = -0.12", "# measured at the bench\nidle_current_A = -1")
    assert BATTERY_FILE.parse(text).idle_current_A == -1.0


def test_the_capacity_stands_once_and_what_is_edited_is_what_holds():
    assert BATTERY_FILE.dump(FULL).count("\ncapacity_Ah = ") == 1
    battery = BATTERY_FILE.parse(edited("\ncapacity_Ah = 2.0", "\ncapacity_Ah = 1.5"))
    assert battery.capacity_Ah == battery.thevenin.capacity_Ah == 1.5


def test_a_second_capacity_is_refused():
    with pytest.raises(InputError, match=r"thevenin.capacity_Ah stands at the head .* remove the one in \[thevenin\]"):
        BATTERY_FILE.parse(edited("[thevenin]\n", "[thevenin]\ncapacity_Ah = 2.0\n"))


def test_a_file_from_a_data_sheet_needs_little():
    text = """
        format = "ohmward-battery/3"
        name = "sheet"
        capacity_Ah = 7
        [thevenin]
        r0_discharge_ohm = [0.02, 0.02]
        r0_charge_ohm = [0.02, 0.02]
        r_ohm = []
        tau_s = []
        [thevenin.ocv]
        voltage_V = [11.8, 12.9]
    """
    battery = BATTERY_FILE.parse(text)
    assert battery.noise == BatteryNoise() and battery.identification is None


@pytest.mark.parametrize(
    "old, new, message",
    [
        ('format = "ohmward-battery/3"\n', "", "the key format is missing"),
        ("ohmward-battery/3", "ohmward-battery/9", "format must be 'ohmward-battery/3', got 'ohmward-battery/9'"),
        (
            "capacity_Ah = 2.0\nchem",
            "capacity_mAh = 2000\nchem",
            "capacity_mAh is not a key .* did you mean capacity_Ah",
        ),
        ("tau_s = [10.0, 500.0]", "tau_ms = [1e4, 5e5]", r"thevenin\.tau_ms is not a key .* did you mean tau_s"),
        ("tau_s = [10.0, 500.0]\n", "", r"thevenin\.tau_s is missing"),
        ("tau_s = [10.0, 500.0]", "tau_s = [500.0, 10.0]", r"thevenin\.tau_s must increase"),
        ("tau_s = [10.0, 500.0]", 'tau_s = [10.0, "500 s"]', r"thevenin\.tau_s\[1\]: expected `float`, got `str`"),
        ("tau_s = [10.0, 500.0]", "tau_s = 10.0", r"thevenin\.tau_s: expected `array`"),
        ("voltage_V = [12.0, 13.2, 14.1]", "voltage_V = [12.0, 14.5, 14.1]", r"ocv\.voltage_V must not fall with SoC"),
        ("voltage_std_V = 0.005", "voltage_std_V = -0.005", r"noise\.voltage_std_V must be > 0, got -0.005"),
        ("voltage_std_V = 0.005", "voltage_std_V = nan", r"noise\.voltage_std_V must be finite"),
        ("n_series = 4", "n_series = 0", "n_series must be >= 1"),
        ("n_series = 4", "n_series = 4.5", "n_series: expected `int`"),
        ("idle_current_A = -0.12", "idle_current_A = 0.12", "idle_current_A must be between -2 and 0, got 0.12"),
        ("voltage_max_V = 14.6", "voltage_max_V = 7", "voltage_min_V must be below voltage_max_V, got 8 and 7"),
        ("[noise]", "[noises]", "noises is not a key of a battery file; did you mean noise"),
        ('test = "pulses"', 'test = "pulses"\ncolour = 1', r"identification\.logs\[0\]\.colour is not a key"),
        ("capacity_Ah = 2.0", "capacity_Ah = = 2.0", "is not valid TOML: .* line"),
        ("name = ", "name = 3 #", "name: expected `str`, got `int`"),
    ],
)
def test_refusals_name_key_rule_and_value(old, new, message):
    with pytest.raises(InputError, match=message):
        BATTERY_FILE.parse(edited(old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("n_series = 4", "n_series = 8", "1.65 V at half charge with n_series = 8, but cells of lfp have 3.29 V"),
        ('chemistry = "lfp"', 'chemistry = "lead-acid"', "but cells of lead-acid have 2.04 V: correct n_series, or"),
        ("capacity_Ah = 2.0\nchem", "capacity_Ah = 2000.0\nchem", "is the capacity in Ah, not mAh"),
        ("voltage_max_V = 14.6", "voltage_max_V = 14600", "voltage_max_V must be at most 28.2 .*got 1.46e.04; in V"),
        ("voltage_std_V = 0.005", "voltage_std_V = 50", "noise.voltage_std_V must be at most 7.05"),
    ],
)
def test_a_key_that_was_edited_against_the_others_is_refused(old, new, message, tmp_path):
    path = tmp_path / "battery.toml"
    path.write_text(edited(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=f"{re.escape(str(path))}: .*{message}"):
        load_battery(path)


def test_a_battery_without_a_circuit_is_refused():
    with pytest.raises(InputError, match="thevenin is missing"):
        BATTERY_FILE.parse('format = "ohmward-battery/3"\nname = "x"\ncapacity_Ah = 1.0\n')


def test_unreadable_files_are_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.toml: cannot be read"):
        load_battery(tmp_path / "nothing.toml")
    with pytest.raises(InputError, match="cannot be read"):
        load_battery(tmp_path)
    (tmp_path / "binary.toml").write_bytes(b"PAR1\xff\xfe")
    with pytest.raises(InputError, match=r"binary\.toml: is not text in UTF-8"):
        load_battery(tmp_path / "binary.toml")
    (tmp_path / "old.toml").write_text('format = "else/1"')
    with pytest.raises(InputError, match=r"old\.toml: format must be"):
        load_battery(tmp_path / "old.toml")


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(OhmwardError, match="cannot be written"):
        save_battery(PLAIN, tmp_path / "no" / "battery.toml")


def test_a_file_that_is_replaced_stays_beside_the_new_one(tmp_path):
    path = tmp_path / "battery.toml"
    first, second = replace(FULL, name="first"), replace(FULL, name="second")
    assert replace_battery(first, path) is None
    assert replace_battery(second, path) == tmp_path / "battery.toml.bak"
    assert load_battery(path).name == "second"
    assert load_battery(tmp_path / "battery.toml.bak").name == "first"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["battery.toml", "battery.toml.bak"]


def test_numbers_of_numpy_are_saved_and_cells_are_whole(tmp_path):
    four: Any = np.int64(4)
    half: Any = 4.5
    battery = replace(generic_battery("lfp", 12.0, 4), n_series=four, capacity_Ah=np.float64(12.0))
    save_battery(battery, tmp_path / "battery.toml")
    loaded = load_battery(tmp_path / "battery.toml")
    assert (loaded.n_series, loaded.capacity_Ah) == (4, 12.0)
    with pytest.raises(InputError, match="n_series must be a whole number of cells"):
        generic_battery("lfp", 12.0, half)
