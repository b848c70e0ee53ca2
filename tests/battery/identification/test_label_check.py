"""Chemistry and number of cells against the voltage of the logs."""

import numpy as np
import pytest

from ohmward.battery.chemistries import CHEMISTRIES, start_model
from ohmward.battery.identification.identify import identify
from ohmward.battery.identification.log_details import OTHER_CELLS, label_notes, unlikely_cells
from ohmward.errors import InputError
from ohmward.logs import Log

NMC_OCV = start_model("nmc", 2.0).ocv


@pytest.mark.parametrize("name", CHEMISTRIES)
@pytest.mark.parametrize("n_series", [1, 4])
def test_a_true_label_is_not_remarked(name, n_series):
    """At any state of charge, and while a charger holds it a little above full."""
    ocv = start_model(name, 2.0, n_series).ocv
    for voltage_V in (*ocv.mean_V(np.linspace(0.0, 1.0, 11), 25.0), 1.05 * ocv.voltage_V[-1]):
        assert label_notes(np.full(9, voltage_V), ocv, name, n_series) == ()


@pytest.mark.parametrize(
    ("voltage_V", "name", "n_series", "advice"),
    [
        (11.2, "nmc", 1, "is 11.2 V a cell with n_series = 1, but cells of nmc have 3 to 4.19 V; 3 or 4 would fit"),
        (3.75, "lead-acid", 1, "; 2 would fit"),
        (2.05, "nmc", 1, "; is the chemistry another one?"),
        (15.5, "lfp", 4, "; 5 or 6 would fit"),
    ],
)
def test_a_contradiction_is_named_with_what_would_fit(voltage_V, name, n_series, advice):
    (note,) = label_notes(np.array([voltage_V, np.nan, voltage_V]), NMC_OCV, name, n_series)
    assert note.level == "warning"
    assert advice in note.text


@pytest.mark.parametrize(("voltage_V", "n_series"), [(12.8, 1), (2 * 3.3, 1), (13.2, 8)])
def test_a_number_of_cells_far_from_the_voltage_is_refused(voltage_V, n_series):
    log = Log("pack", np.arange(9.0), np.zeros(9), np.full(9, voltage_V))
    with pytest.raises(InputError, match=r"would fit \(--n-series, n_series=\)"):
        identify(log, capacity_Ah=2.0, chemistry="lfp", n_series=n_series)


def test_a_long_charge_is_not_refused():
    """Lead-acid cells at 2.45 V gas: 15 % above a full one at rest, which is told and no more."""
    assert unlikely_cells(np.full(9, 6 * 2.45), "lead-acid", 6) != ""
    assert unlikely_cells(np.full(9, 6 * 2.45), "lead-acid", 6, OTHER_CELLS) == ""


@pytest.mark.parametrize(("name", "other"), [("lfp", "nmc"), ("nmc", "lfp")])
def test_a_curve_of_another_chemistry_is_named(name, other):
    """Both chemistries have the same usual voltage: the curve tells them apart."""
    (note,) = label_notes(np.full(9, 4 * 3.3), start_model(other, 2.0, 4).ocv, name, 4)
    assert note.level == "warning"
    assert f"differs from that of {name} cells" in note.text and other in note.text.split("the curve fits")[1]


def test_without_a_chemistry_nothing_is_said():
    assert label_notes(np.full(9, 50.0), NMC_OCV, "", 1) == ()
