import pytest

from ohmward.embedded import twin


@pytest.fixture
def quickly_compiled(monkeypatch):
    """Twins without the compiler's optimisation, which takes seconds for large filters; the bits are the same."""
    monkeypatch.setattr(twin, "FLAGS", tuple(flag.replace("-O2", "-O0") for flag in twin.FLAGS))
