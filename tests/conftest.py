"""Settings of all tests."""

import gc

# Traced programs are many objects that live long; at the usual threshold the collector walks through them all the time.
gc.set_threshold(100_000, 20, 20)
