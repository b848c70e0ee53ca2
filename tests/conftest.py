"""Settings of all tests."""

import gc

from hypothesis import settings

# Traced programs are many objects that live long; at the usual threshold the collector walks through them all the time.
gc.set_threshold(100_000, 20, 20)

# An example that takes long beside other work is no failure; tests of speed measure by themselves.
settings.register_profile("ohmward", deadline=None)
settings.load_profile("ohmward")
