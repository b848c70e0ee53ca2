"""Every peer that is installed comes to our numbers, one log and many; what is not installed is said."""

import sys
from functools import partial

import numpy as np
import pytest

from ohmward.filters.belief import unpack
from scripts import script

pytest.importorskip("scipy")
pytest.importorskip("llvmlite")

peers, workloads, filter_speed = script("peers"), script("workloads"), script("filter_speed")

STEPS, CHECKED, LOGS = 1200, 40, 9
#: More than a block of those that run the log in blocks.
WHOLE = 600
CASES = list(filter_speed.cases(STEPS))
by_case = pytest.mark.parametrize("case", CASES, ids=lambda c: c.name)


def with_floats(case, steps):
    """Our step as it is written, without tracing."""
    state = case.start(case.problem.drive)
    for k in range(steps):
        sample = workloads.SocSample(*(float(column[k]) for column in case.problem.drive.samples))
        state, _ = case.estimator.step(state, sample)
    return workloads.Posterior(*unpack(state.belief))


@by_case
def test_the_matrices_in_numpy_are_our_filter(case):
    redrawn = isinstance(case.problem, workloads.CellProblem)
    expected = filter_speed.reference(case.problem, redrawn, CHECKED)
    assert workloads.disagreement(with_floats(case, CHECKED), expected) < 1e-9


def test_redrawing_the_points_makes_another_filter():
    problem = CASES[0].problem
    reused, redrawn = (filter_speed.reference(problem, redraw, CHECKED) for redraw in (False, True))
    assert workloads.disagreement(redrawn, reused) > 1e-4


@pytest.mark.slow
@by_case
def test_every_peer_agrees(case):
    for c in peers.contestants(case.problem):
        if isinstance(c, peers.Contestant):
            expected = filter_speed.reference(case.problem, c.redrawn, WHOLE)
            assert workloads.disagreement(c.run(WHOLE), expected) < filter_speed.AGREED, (c.who, c.how)


@pytest.mark.slow
@by_case
def test_every_peer_agrees_on_many_logs(case):
    problem = case.problem._replace(drive=filter_speed.pieces(case.problem.drive, LOGS))
    first = problem._replace(drive=workloads.Drive(*(column[:, 0] for column in problem.drive)))
    ours = [filter_speed.ours_on_lanes(case, problem.drive, "f64"), filter_speed.ours_in_numpy(case, problem.drive)]
    found = [c for c in peers.contestants(problem, lanes=True) if isinstance(c, peers.Contestant)]
    assert "NumPy by hand" in [c.who for c in found]
    for c in [*ours, *found]:
        c = c._replace(steps=CHECKED)
        expected = filter_speed.lane_reference(first, c)
        assert workloads.disagreement(c.run(CHECKED), expected) < filter_speed.AGREED, (c.who, c.how)


def test_another_result_is_called_so():
    problem = CASES[2].problem
    wrong = problem._replace(R=1.01 * problem.R)
    c = peers.Contestant("someone", "", 1000, partial(script("peers.numpy_by_hand").run_cell, wrong))
    assert "another result" in filter_speed.agreement(problem, c)


def test_a_peer_that_is_not_installed_is_said(monkeypatch):
    monkeypatch.setattr(peers, "PEERS", (peers.Peer("NoSuch", "nosuch", "in_filterpy"),))
    monkeypatch.setitem(sys.modules, "filterpy", None)
    monkeypatch.setitem(sys.modules, "filterpy.kalman", None)
    monkeypatch.delitem(sys.modules, "peers.in_filterpy", raising=False)
    (absent,) = peers.contestants(CASES[1].problem)
    assert filter_speed.absent_row(absent, 3) == ("NoSuch", "not installed: pip install nosuch", "")


def test_pieces_begin_with_the_current_that_they_had():
    drive = filter_speed.pieces(CASES[0].problem.drive, 3)
    np.testing.assert_array_equal(drive.mean_A[0], drive.current_A[0])
    np.testing.assert_allclose(drive.mean_A[1:], 0.5 * (drive.current_A[1:] + drive.current_A[:-1]), atol=1e-15)
