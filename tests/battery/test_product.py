"""The battery of a type: what several of a product have in common, in doubt by what they differ by."""

from dataclasses import replace

import numpy as np
import pytest

from ohmward.battery.battery import Battery
from ohmward.battery.chemistries import generic_battery
from ohmward.battery.file import load_battery, save_battery
from ohmward.battery.models.thevenin import Thevenin
from ohmward.battery.product import battery_of_type
from ohmward.cli.main import main
from ohmward.errors import InputError

CELL = generic_battery("nca", 3.0, label="cell")


def with_model(model: Thevenin, name: str = "other") -> Battery:
    return replace(CELL, name=name, capacity_Ah=model.capacity_Ah, thevenin=model)


def at(battery: Battery, soc: np.ndarray, degC: float) -> list[np.ndarray]:
    """Open-circuit voltage, hysteresis and resistances of a battery."""
    model = battery.thevenin
    grid = np.linspace(0.0, 1.0, len(model.r0_charge_ohm))
    pairs = model.pair_arrhenius_factor(degC) * model.emptying_factor(soc, degC)
    return [
        model.ocv.mean_V(soc, degC),
        model.ocv.hysteresis_at(soc),
        model.arrhenius_factor(degC) * np.interp(soc, grid, model.r0_charge_ohm),
        *(pairs * np.interp(soc, grid, row) for row in model.r_ohm),
        np.array(model.tau_s) / model.rate_arrhenius_factor(degC),
    ]


def test_batteries_that_differ_by_factors_either_way_have_the_middle_in_common():
    more, less = with_model(CELL.thevenin.worn(1.25, 0.8)), with_model(CELL.thevenin.worn(0.8, 1.25))
    found = battery_of_type([more, less])
    assert found.capacity_Ah == pytest.approx(3.0)
    for ours, own in zip(
        at(found, np.linspace(0.0, 1.0, 21), 10.0), at(CELL, np.linspace(0.0, 1.0, 21), 10.0), strict=True
    ):
        np.testing.assert_allclose(ours, own, rtol=1e-9, atol=1e-12)


def test_a_battery_tested_at_another_temperature_is_the_same_one():
    model = CELL.thevenin
    grid = np.linspace(0.0, 1.0, len(model.r0_charge_ohm))
    ohmic, pairs = model.arrhenius_factor(5.0), model.pair_arrhenius_factor(5.0) * model.emptying_factor(grid, 5.0)
    colder = replace(
        model,
        reference_degC=5.0,
        r0_charge_ohm=tuple(ohmic * np.array(model.r0_charge_ohm)),
        r0_discharge_ohm=tuple(ohmic * np.array(model.r0_discharge_ohm)),
        r_ohm=tuple(tuple(pairs * np.array(row)) for row in model.r_ohm),
        tau_s=tuple(tau_s / model.rate_arrhenius_factor(5.0) for tau_s in model.tau_s),
    )
    found = battery_of_type([CELL, with_model(colder)])
    for ours, own in zip(at(found, grid, -5.0), at(CELL, grid, -5.0), strict=True):
        np.testing.assert_allclose(ours, own, rtol=1e-9)


def test_a_pack_of_the_type_has_its_cells_voltages_and_less_of_their_spread():
    cell, pack = (battery_of_type([CELL, replace(CELL, name="other")], n_series=n) for n in (1, 4))
    assert pack.n_series == 4 and pack.thevenin == cell.thevenin.in_series(4)
    assert pack.voltage_max_V == 4 * cell.voltage_max_V
    ratio = np.array(pack.noise.model_std_V) / np.array(cell.noise.model_std_V)
    assert (ratio <= 4.0).all() and (ratio > 2.0).all()


def test_its_doubt_is_what_the_batteries_differ_by():
    """Two that differ by d about their mean, beside the usual spread that counts as two: s^2 = (2 s0^2 + d^2/2) / 3."""
    alike = battery_of_type([CELL, replace(CELL, name="other")])
    larger = with_model(replace(CELL.thevenin, capacity_Ah=3.0 * np.exp(0.2)))
    unlike = battery_of_type([CELL, larger])
    assert unlike.noise.capacity_std**2 - alike.noise.capacity_std**2 == pytest.approx(1.5 * 0.2**2 / 2.0 / 3.0)
    higher = replace(
        CELL.thevenin, ocv=replace(CELL.thevenin.ocv, voltage_V=tuple(v + 0.02 for v in CELL.thevenin.ocv.voltage_V))
    )
    apart = np.array(battery_of_type([CELL, with_model(higher)]).noise.model_std_V)
    np.testing.assert_allclose(apart**2 - np.array(alike.noise.model_std_V) ** 2, 1.5 * 0.02**2 / 2.0 / 3.0, rtol=1e-6)


@pytest.mark.parametrize(
    ("batteries", "n_series", "message"),
    [
        ([CELL], None, "files of two batteries or more"),
        ([CELL, generic_battery("lfp", 3.0)], None, "differ in their chemistry: cell nca, generic lfp lfp"),
        (
            [CELL, generic_battery("nca", 3.0, 4)],
            None,
            "differ in their number of cells in series: cell 1, generic nca 4",
        ),
        (
            [CELL, with_model(replace(CELL.thevenin, r_ohm=(), tau_s=()))],
            None,
            "identify all with --model thevenin-2rc",
        ),
        ([CELL, CELL], None, "cell is given twice"),
        ([CELL, generic_battery("nca", 3000.0)], None, "their capacity: cell 3 Ah, generic nca 3000 Ah; .* mAh"),
        (
            [CELL, replace(generic_battery("lfp", 3.0), chemistry="nca")],
            None,
            r"their open-circuit voltage: cell \d+ mV, generic lfp \d+ mV; RMS .* another chemistry",
        ),
        (
            [generic_battery("nca", 3.0, 2, label=name) for name in "ab"],
            3,
            "n_series must be a multiple of that of the files, 2, got 3",
        ),
    ],
)
def test_batteries_of_several_types_are_refused(batteries, n_series, message):
    with pytest.raises(InputError, match=message):
        battery_of_type(batteries, n_series)


def test_the_command_writes_its_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        save_battery(replace(CELL, name=name), f"{name}.toml")
    assert main(["generic", "--type-of", "a.toml", "b.toml", "--n-series", "4", "-o", "pack.toml"]) == 0
    found = load_battery("pack.toml")
    assert (found.name, found.n_series) == ("type of a", 4)
    assert found.identification and found.identification.notes == ("of the type of 2 batteries: a, b",)
    for words, message in (
        (["--type-of", "a.toml", "b.toml", "-o", "a.toml"], "a.toml"),
        (["--type-of", "a.toml", "b.toml", "--chemistry", "nca", "-o", "c.toml"], "leave the other options out"),
        (["-o", "c.toml"], "--chemistry is needed"),
    ):
        assert main(["generic", *words]) == 2
        assert message in capsys.readouterr().err
