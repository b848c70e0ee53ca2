"""Clocks for tests."""

from ohmward.onboard.clock import SystemClock


class FakeClock(SystemClock):
    def __init__(self, now_s=1000.0, unix_s=1.8e9):
        self.monotonic, self.unix, self.suspended, self.set = now_s, unix_s, 0.0, True

    def now_s(self):
        return self.monotonic

    def unix_s(self):
        return self.unix

    def is_set(self):
        return self.set

    def suspended_s(self):
        return self.suspended
