"""Force of a law of the ground at a slip, and the slip of the least energy by SciPy."""

from scipy.optimize import minimize_scalar

from ohmward.traction.friction.law import contact


def driving_force(law, slip_ratio, load_N, travel_speed_m_s):
    """Force [N] at a slip ratio in [0, 1) and a travel speed > 0."""
    return law.force_N(contact(travel_speed_m_s / (1 - slip_ratio), travel_speed_m_s, load_N))


def best_slip_ratio(law, load_N, resistance_N, travel_speed_m_s):
    """The slip at which a driving wheel turns the largest share of its power, (1 - slip) (1 - R/F), into pull."""

    def waste(slip):
        return -(1 - slip) * (1 - resistance_N / driving_force(law, slip, load_N, travel_speed_m_s))

    return minimize_scalar(waste, bounds=(1e-4, 0.9), method="bounded", options={"xatol": 1e-10}).x
