"""Tables against np.interp and SciPy's PCHIP, with floats and in every lowering."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from ohmward.errors import InputError
from ohmward.trace import Kernel, jacobian, monotone_slopes, table, trace

START, SPACING = -0.5, 0.125
KINDS = ("linear", "hermite")
values_of_a_table = st.lists(st.floats(-10, 10).map(lambda v: round(v, 3)), min_size=2, max_size=9)


def grid(values):
    return START + SPACING * np.arange(len(values))


def inside(values, count=101):
    return np.linspace(grid(values)[0], grid(values)[-1], count)


@given(values_of_a_table)
def test_linear_is_numpys_interp(values):
    x = inside(values)
    np.testing.assert_allclose(table(values, START, SPACING, x), np.interp(x, grid(values), values), atol=1e-12)


@given(values_of_a_table)
def test_many_values_on_few_lines_are_numpys_interp_too(values):
    fine = np.interp(np.linspace(0.0, 1.0, 20 * (len(values) - 1) + 1), np.linspace(0.0, 1.0, len(values)), values)
    at = START + SPACING / 20 * np.arange(len(fine))
    x = np.linspace(at[0], at[-1], 301)
    np.testing.assert_allclose(table(fine, START, SPACING / 20, x), np.interp(x, at, fine), atol=1e-11)
    for end, inner in ((0, 1), (-1, -2)):
        beyond = table(fine, START, SPACING / 20, 2.0 * at[end] - at[inner])
        assert beyond == pytest.approx(2.0 * fine[end] - fine[inner], abs=1e-11)


def test_values_on_few_lines_take_less_memory_and_a_straight_one_none():
    bent = trace(lambda x: table(np.interp(np.arange(101.0), (0, 30, 100), (3.0, 3.5, 4.0)), 0.0, 0.01, x), 0.0)
    assert [len(n.args[1]) for n in bent.nodes if n.operation.name == "gather"] == [102, 2, 2]
    straight = trace(lambda x: table(np.linspace(1.0, 2.0, 101), 0.0, 0.01, x), 0.0)
    assert straight.operations["gather"] == 0 and straight.operations["floor"] == 0


@given(values_of_a_table)
def test_hermite_is_scipys_pchip(values):
    x = inside(values)
    expected = PchipInterpolator(grid(values), values)(x)
    np.testing.assert_allclose(table(values, START, SPACING, x, "hermite"), expected, atol=1e-11)


@given(values_of_a_table)
def test_slopes_are_scipys(values):
    expected = PchipInterpolator(np.arange(float(len(values))), values).derivative()(np.arange(float(len(values))))
    np.testing.assert_allclose(monotone_slopes(np.array(values)), expected, atol=1e-11)


@given(values_of_a_table.map(sorted))
def test_hermite_of_rising_values_rises(values):
    assert (np.diff(table(values, START, SPACING, inside(values), "hermite")) >= -1e-12).all()


@pytest.mark.parametrize("kind", KINDS)
def test_values_are_met_on_the_grid(kind):
    values = [3.0, 3.4, 3.5, 3.45, 4.0]
    np.testing.assert_array_equal(table(values, START, SPACING, grid(values), kind), values)


@pytest.mark.parametrize("kind", KINDS)
def test_beyond_the_ends_it_goes_on_straight(kind):
    values = [1.0, 2.0, 2.5, 4.0]
    slope = jacobian(lambda x: np.array([table(values, 0.0, 1.0, x[0], kind)]))
    for end, value, outward in ((0.0, 1.0, -1.0), (3.0, 4.0, 1.0)):
        (m,) = slope(np.array([end]))[0]
        for distance in (1e-9, 0.5, 7.0):
            x = end + outward * distance
            assert table(values, 0.0, 1.0, x, kind) == pytest.approx(value + m * (x - end), rel=1e-12)
            assert slope(np.array([x]))[0, 0] == pytest.approx(m, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_derivative_is_scipys(kind):
    values = [1.0, 2.0, 2.5, 4.0, 3.0]
    x = inside(values, 37)
    found = np.diagonal(jacobian(lambda x: table(values, START, SPACING, x, kind))(x))
    if kind == "hermite":
        expected = PchipInterpolator(grid(values), values).derivative()(x)
    else:
        expected = np.diff(values)[np.clip((x - START) // SPACING, 0, 3).astype(int)] / SPACING
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_every_lowering_gives_the_same_bits(kind):
    values = [1.0, 2.0, 2.5, 4.0, 3.0]
    x = np.array([*np.linspace(-2, 2, 83), np.nan, -1e300, 1e300, 0.0, -0.0])
    kernel = Kernel(lambda s, x: (s, table(values, START, SPACING, x, kind)), (), 0.0)
    with_floats = np.array([table(values, START, SPACING, float(v), kind) for v in x])
    np.testing.assert_array_equal(table(values, START, SPACING, x, kind), with_floats)
    np.testing.assert_array_equal(kernel.scan((), x)[1], with_floats)
    np.testing.assert_array_equal(kernel.scan_lanes((), x[None])[1][0], with_floats)
    np.testing.assert_array_equal([kernel((), v)[1] for v in x], with_floats)


@pytest.mark.parametrize("kind", KINDS)
def test_nan_gives_nan(kind):
    assert np.isnan(table([1.0, 2.0, 3.0], 0.0, 1.0, np.nan, kind))


@pytest.mark.parametrize(
    "arguments, words",
    [
        (([1.0], 0.0, 1.0, 0.5), "values must be 2 or more finite numbers"),
        (([1.0, np.nan], 0.0, 1.0, 0.5), "values must be 2 or more finite numbers"),
        (([1.0, 2.0], 0.0, 0.0, 0.5), "spacing must be > 0, got 0"),
        (([1.0, 2.0], 0.0, 1.0, 0.5, "spline"), 'kind must be "linear" or "hermite", got \'spline\''),
    ],
)
def test_what_makes_no_curve_is_refused(arguments, words):
    with pytest.raises(InputError, match=words):
        table(*arguments)
