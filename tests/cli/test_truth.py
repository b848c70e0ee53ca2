import numpy as np
import pytest

from ohmward.cli.battery_inputs import read_soc_truth
from ohmward.errors import InputError
from ohmward.logs import Log

TIME_S = np.arange(0.0, 3601.0)


def log(**extra) -> Log:
    # 1 A out for one hour: 1 Ah
    return Log("x", TIME_S, np.full(TIME_S.size, -1.0), np.full(TIME_S.size, 12.0), None, extra)


def test_one_counter_for_each_direction():
    extra = {"chg_Ah": np.zeros(TIME_S.size), "dis_Ah": TIME_S / 3600}
    assert read_soc_truth(log(**extra), "chg_Ah - dis_Ah", 2.0, 1.0).soc[-1] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("extra", "column", "start", "message"),
    [
        ({"soc": TIME_S}, "sox", None, "did you mean 'soc'"),
        ({}, "soc", None, "no further numeric columns"),
        ({"soc": TIME_S}, "soc", None, "runs from 0 to 3600"),
        ({"soc": np.full(TIME_S.size, np.nan)}, "soc", None, "has no value"),
        ({"Ah": TIME_S / 3600}, "Ah", None, "--truth-start"),
        ({"Ah": TIME_S / 360}, "Ah", 1.0, "would lead from -4 to 1"),
        ({"a": TIME_S}, "a - b", None, "no column 'b'"),
    ],
)
def test_what_is_refused(extra, column, start, message):
    with pytest.raises(InputError, match=message):
        read_soc_truth(log(**extra), column, 2.0, start)
