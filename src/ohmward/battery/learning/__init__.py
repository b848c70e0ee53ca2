"""Learning a battery from everyday logs: parameters, samples of a log, voltage model, solution, fold into the file."""

from ohmward.battery.learning.learn import Learnt, Lesson, learn

__all__ = ["Learnt", "Lesson", "learn"]
