import pytest

from ohmward.errors import InputError
from ohmward.onboard.secrets import secret


def test_from_the_environment(monkeypatch):
    monkeypatch.setenv("ROBOT_SECRET", "sesame")
    assert secret("password", "ROBOT_SECRET") == "sesame"
    monkeypatch.delenv("ROBOT_SECRET")
    with pytest.raises(InputError, match="ROBOT_SECRET is not set"):
        secret("password", "ROBOT_SECRET")


def test_from_a_file_of_the_owner_only(tmp_path):
    path = tmp_path / "secret"
    path.write_text("sesame\n")
    path.chmod(0o600)
    assert secret("password", f"file:{path}") == "sesame"
    path.chmod(0o640)
    with pytest.raises(InputError, match=r"others may read .* \(mode 640\); chmod 600") as found:
        secret("password", f"file:{path}")
    assert "sesame" not in str(found.value)
    with pytest.raises(InputError, match="cannot be read"):
        secret("password", f"file:{tmp_path / 'none'}")


def test_a_system_without_modes_has_none_to_check(tmp_path, monkeypatch):
    path = tmp_path / "secret"
    path.write_text("sesame\n")
    path.chmod(0o666)  # of every file that can be written on Windows
    monkeypatch.setattr("ohmward.onboard.secrets.HAS_MODES", False)
    assert secret("password", f"file:{path}") == "sesame"


@pytest.mark.parametrize("given", ["pa55-word!", "pa55word", "Pa55"])
def test_a_secret_that_stands_in_the_setup_is_refused_without_being_shown(given):
    with pytest.raises(InputError, match="says where the secret is") as found:
        secret("password", given)
    assert given not in str(found.value)
