import json
import re
from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from ohmward.battery.bpx import battery_from_bpx
from ohmward.battery.file import load_battery
from ohmward.cli.main import main
from ohmward.errors import InputError

FARADAY, GAS = 96485.33212, 8.314462618
#: A cell of straight potentials, by which everything has a closed form.
CELL: dict[str, Any] = {
    "Header": {"BPX": "1.0.0", "Title": "Straight", "Model": "DFN"},
    "Parameterisation": {
        "Cell": {
            "Electrode area [m2]": 0.05,
            "Number of electrode pairs connected in parallel to make a cell": 2,
            "Nominal cell capacity [A.h]": 4.0,
            "Lower voltage cut-off [V]": 2.5,
            "Upper voltage cut-off [V]": 4.2,
            "Reference temperature [K]": 298.15,
        },
        "Electrolyte": {
            "Conductivity [S.m-1]": "1.0 + 0.0 * exp(-x)",
            "Conductivity activation energy [J.mol-1]": 17000,
        },
        "Negative electrode": {
            "Particle radius [m]": 5e-6,
            "Thickness [m]": 8e-5,
            "Diffusivity [m2.s-1]": 2e-14,
            "OCP [V]": "0.3 - 0.2 * x",
            "Entropic change coefficient [V.K-1]": 1e-4,
            "Conductivity [S.m-1]": 100.0,
            "Surface area per unit volume [m-1]": 4e5,
            "Transport efficiency": 0.1,
            "Reaction rate constant [mol.m-2.s-1]": 5e-6,
            "Minimum stoichiometry": 0.05,
            "Maximum stoichiometry": 0.85,
            "Maximum concentration [mol.m-3]": 30000.0,
            "Diffusivity activation energy [J.mol-1]": 30000,
            "Reaction rate constant activation energy [J.mol-1]": 50000,
        },
        "Positive electrode": {
            "Particle radius [m]": 4e-6,
            "Thickness [m]": 7e-5,
            "Diffusivity [m2.s-1]": 1e-14,
            "OCP [V]": {"x": [0.0, 1.0], "y": [4.5, 3.5]},
            "Entropic change coefficient [V.K-1]": -1e-4,
            "Conductivity [S.m-1]": 10.0,
            "Surface area per unit volume [m-1]": 4e5,
            "Transport efficiency": 0.15,
            "Reaction rate constant [mol.m-2.s-1]": 1e-5,
            "Minimum stoichiometry": 0.3,
            "Maximum stoichiometry": 0.95,
            "Maximum concentration [mol.m-3]": 50000.0,
            "Diffusivity activation energy [J.mol-1]": 20000,
            "Reaction rate constant activation energy [J.mol-1]": 40000,
        },
        "Separator": {"Thickness [m]": 2e-5, "Transport efficiency": 0.3},
    },
}
AREA = 0.1


def saved(tmp_path, change=None):
    """Path of the cell's file; change: made to its parameterisation."""
    content = deepcopy(CELL)
    if change:
        change(content["Parameterisation"])
    path = tmp_path / "cell.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def charge_As(electrode):
    volume = electrode["Surface area per unit volume [m-1]"] * electrode["Particle radius [m]"] / 3.0
    return FARADAY * electrode["Maximum concentration [mol.m-3]"] * volume * electrode["Thickness [m]"] * AREA


def test_curve_and_capacity_are_those_of_the_electrodes(tmp_path):
    battery = battery_from_bpx(saved(tmp_path), "nmc")
    z = np.linspace(0.0, 1.0, 5)
    expected = 4.5 - (0.95 - 0.65 * z) - (0.3 - 0.2 * (0.05 + 0.8 * z))
    assert battery.thevenin.ocv.mean_V(z, 25.0) == pytest.approx(expected, abs=1e-6)
    assert battery.thevenin.ocv.mean_V(z, 35.0) == pytest.approx(expected - 10.0 * 2e-4, abs=1e-6)
    negative, positive = (CELL["Parameterisation"][f"{side} electrode"] for side in ("Negative", "Positive"))
    least_As = min(0.8 * charge_As(negative), 0.65 * charge_As(positive))
    assert battery.capacity_Ah == pytest.approx(least_As / 3600.0)
    assert battery.name == "Straight"


def test_the_ohmic_resistance_is_that_of_layers_and_of_charge_transfer(tmp_path):
    p = battery_from_bpx(saved(tmp_path), "nmc").thevenin
    layers = (8e-5 / (3 * 100) + 8e-5 / (3 * 0.1) + 7e-5 / (3 * 10) + 7e-5 / (3 * 0.15) + 2e-5 / 0.3) / AREA
    x_n, x_p = 0.05 + 0.8 * 0.5, 0.95 - 0.65 * 0.5
    transfer = 0.0
    for x, rate, thickness in ((x_n, 5e-6, 8e-5), (x_p, 1e-5, 7e-5)):
        exchange_A = FARADAY * rate * np.sqrt(x * (1 - x)) * 4e5 * thickness * AREA
        transfer += GAS * 298.15 / (FARADAY * exchange_A)
    assert p.r0_discharge_ohm[10] == pytest.approx(layers + transfer, rel=1e-6)
    assert 17000 / GAS < p.activation_K < 50000 / GAS


def surface_of_a_sphere(radius_m, diffusivity, flux, seconds, shells=60):
    """Concentration of the surface less the mean along seconds, by finite volumes: an oracle for the pair."""
    edges = np.linspace(0.0, radius_m, shells + 1)
    volumes, areas = np.diff(edges**3) / 3.0, edges**2
    middles = 0.5 * (edges[1:] + edges[:-1])
    conductance = diffusivity * areas[1:-1] / np.diff(middles)
    L = np.zeros((shells, shells))
    for k, g in enumerate(conductance):
        L[[k, k + 1], [k, k + 1]] -= g
        L[[k, k + 1], [k + 1, k]] += g
    L /= volumes[:, None]
    source = np.zeros(shells)
    source[-1] = flux * areas[-1] / volumes[-1]
    step_s = 0.5
    stepped, c, found = np.linalg.inv(np.eye(shells) - step_s * L), np.zeros(shells), []
    for _ in range(int(seconds / step_s)):
        c = stepped @ (c + step_s * source)
        surface = c[-1] + flux * (edges[-1] - middles[-1]) / diffusivity
        found.append(surface - volumes @ c / volumes.sum())
    return step_s * np.arange(1, len(found) + 1), np.array(found)


def test_a_pair_is_the_diffusion_in_a_sphere_by_its_end_and_its_area(tmp_path):
    p = battery_from_bpx(saved(tmp_path), "nmc").thevenin
    negative = CELL["Parameterisation"]["Negative electrode"]
    radius, D, current_A = 5e-6, 2e-14, 1.0
    surface_m2 = 4e5 * 8e-5 * AREA
    t, c = surface_of_a_sphere(radius, D, current_A / (FARADAY * surface_m2), 1500.0)
    volts = 0.2 * c / negative["Maximum concentration [mol.m-3]"]
    j = int(np.argmin(np.abs(np.array(p.tau_s) - radius**2 / (35.0 * D))))
    assert p.r_ohm[j][10] * current_A == pytest.approx(volts[-1], rel=0.02)
    assert p.tau_s[j] == pytest.approx(np.trapezoid(1.0 - volts / volts[-1], t), rel=0.05)


def test_a_pack_of_strings(tmp_path):
    one = battery_from_bpx(saved(tmp_path), "nmc")
    pack = battery_from_bpx(saved(tmp_path), "nmc", n_series=4, capacity_Ah=3.0 * one.capacity_Ah, label="pack")
    assert (pack.name, pack.n_series, pack.capacity_Ah) == ("pack", 4, pytest.approx(3.0 * one.capacity_Ah))
    assert pack.thevenin.r0_discharge_ohm == pytest.approx([4 / 3 * r for r in one.thevenin.r0_discharge_ohm])
    assert pack.thevenin.ocv.voltage_V == pytest.approx([4 * v for v in one.thevenin.ocv.voltage_V])


def changed(part, key, value):
    return lambda p: p[part].update({key: value})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: p.pop("Negative electrode"), "has no Parameterisation / Negative electrode"),
        (changed("Negative electrode", "Particle", {}), "is a blend of materials"),
        (changed("Positive electrode", "OCP [V]", "__import__('os').getcwd()"), "is no expression in x"),
        (changed("Positive electrode", "OCP [V]", "4 -"), '"OCP .V." cannot be read'),
        (changed("Positive electrode", "OCP [V]", [1, 2]), "neither a number, a table of x and y, nor an expression"),
        (changed("Positive electrode", "Thickness [m]", "thin"), "must be a number, got 'thin'"),
        (changed("Cell", "Electrode area [m2]", -1), "must be > 0"),
        (changed("Negative electrode", "Maximum stoichiometry", 0.01), "must rise within 0 to 1"),
        (changed("Cell", "Nominal cell capacity [A.h]", 40.0), "the electrodes hold"),
    ],
)
def test_what_is_wrong_is_named(change, message, tmp_path):
    with pytest.raises(InputError, match=message):
        battery_from_bpx(saved(tmp_path, change), "nmc")


@pytest.mark.parametrize(
    ("text", "message"), [("{", "cannot be read"), ("[]", "is no BPX file"), ("{}", "is no BPX file")]
)
def test_a_file_that_is_none(text, message, tmp_path):
    path = tmp_path / "cell.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        battery_from_bpx(path, "nmc")


def test_a_single_particle_file_has_no_electrolyte(tmp_path):
    without = battery_from_bpx(saved(tmp_path, lambda p: (p.pop("Electrolyte"), p.pop("Separator"))), "nmc")
    whole = battery_from_bpx(saved(tmp_path), "nmc")
    assert without.thevenin.r0_discharge_ohm[10] < whole.thevenin.r0_discharge_ohm[10]


def test_the_command_writes_a_battery_file(tmp_path, monkeypatch, capsys):
    saved(tmp_path)
    monkeypatch.chdir(tmp_path)
    words = ["generic", "--chemistry", "nmc", "--n-series", "4", "-o", "battery.toml"]
    assert main([*words, "--bpx", "cell.json"]) == 0
    assert load_battery("battery.toml").n_series == 4
    assert "curve and resistances are those of cell.json" in capsys.readouterr().out
    assert main(words) == 2
    assert "--capacity-ah is needed, as on the label, or --bpx" in capsys.readouterr().err


def test_a_curve_of_another_chemistry_is_refused(tmp_path):
    (tmp_path / "cell.json").write_text(json.dumps(CELL))
    with pytest.raises(InputError, match=r"differs from that of lfp cells by 10 .*the curve fits nca or sodium-ion"):
        battery_from_bpx(tmp_path / "cell.json", "LiFePO4")


@pytest.mark.parametrize(("given", "origin"), [(None, r"that of the electrodes \(4 Ah nominal\)"), (8.0, "as given")])
def test_the_origin_of_the_capacity_is_named(tmp_path, given, origin):
    (tmp_path / "cell.json").write_text(json.dumps(CELL))
    *_, capacity = battery_from_bpx(tmp_path / "cell.json", "nmc", capacity_Ah=given).not_identified
    assert re.match(f"capacity: {origin}, assumed to be right within", capacity)
