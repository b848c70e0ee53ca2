"""Learning a battery from everyday logs: parameters, samples of a log, voltage model, solution, fold into the file."""

from ohmward.battery.learning.learn import Learnt, learn
from ohmward.battery.learning.log_update import LogUpdate

__all__ = ["Learnt", "LogUpdate", "learn"]
