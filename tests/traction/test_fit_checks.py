"""Notes on a run that met faults, and on one that the model does not fit."""

import numpy as np
import pytest

from ohmward.traction.observed_drive import fit_notes, misfits
from ohmward.traction.speed_observer.estimate import SlipEstimate, SlipFlag
from ohmward.traction.speed_observer.estimator import SlipRun

SAMPLES = 200


def run(flag, count):
    """A run in which so many samples carry a flag."""
    flags = np.where(np.arange(SAMPLES) < count, float(flag), 0.0)
    nothing = dict.fromkeys(SlipEstimate._fields, np.zeros(SAMPLES))
    return SlipRun(np.arange(SAMPLES), SlipEstimate(**nothing | {"flags": flags}), 0.0)


def test_a_run_without_incident_fits():
    assert fit_notes(run(SlipFlag.GROUND_CHANGED, SAMPLES)) == ()


def test_spikes_are_warned_of_and_fit():
    (note,) = fit_notes(run(SlipFlag.ENCODER_SPIKE, 10))
    assert note.level == "warning" and "10 of 200 samples in which an encoder jumps" in note.text
    assert misfits(run(SlipFlag.ENCODER_SPIKE, 10)) == ()


@pytest.mark.parametrize(
    ("flag", "word"),
    [(SlipFlag.ENCODER_REJECTED, "encoders"), (SlipFlag.GYRO_REJECTED, "gyro"), (SlipFlag.SPEED_REJECTED, "outside")],
)
def test_a_sensor_that_is_refused_for_long_does_not_fit(flag, word):
    assert misfits(run(flag, SAMPLES // 10)) == ()
    (note,) = misfits(run(flag, SAMPLES // 4))
    assert "does not fit 25 % of the log" in note.text and word in note.text


def test_one_restart_is_enough():
    (note,) = misfits(run(SlipFlag.RESTARTED, 1))
    assert "started again 1 times" in note.text
