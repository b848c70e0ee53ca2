import pytest

from cli.examples import CAPACITY_AH, MODEL
from ohmward.battery.file import load_battery
from ohmward.cli.main import main

IDENTIFY = ("identify", "test.csv", "--capacity-ah", "12", "--model", "thevenin-1rc", "--n-series", "3", "--name", "A")


@pytest.fixture
def identified(here, as_json) -> dict:
    return as_json(*IDENTIFY, "-o", "new.toml", "--report", "identify.html", "--chemistry", "nmc")


def test_the_file_holds_what_was_said_and_found(identified):
    battery = load_battery("new.toml")
    assert (battery.name, battery.chemistry, battery.n_series) == ("A", "nmc", 3)
    assert battery.capacity_Ah == CAPACITY_AH
    assert battery.thevenin and battery.thevenin.pairs == 1
    # the ohmic drop of the file and half a pair or so that one time constant cannot tell from it
    assert battery.thevenin.r0_discharge_ohm[10] == pytest.approx(MODEL.r0_discharge_ohm[0], rel=0.3)


def test_json(identified):
    assert identified["output"] == "new.toml"
    assert identified["model"] == "thevenin-1rc"
    names = {p["name"] for p in identified["parameters"]}
    assert {"r0_discharge_ohm at soc 0.5", "tau1_s"} <= names
    assert all(p["low"] <= p["value"] <= p["high"] for p in identified["parameters"])
    assert identified["logs"][0]["residual_rms_V"] < 0.05
    assert any("charge" in text for text in identified["not_identified"])
    assert identified["seconds"] > 0


def test_a_test_that_the_model_does_not_fit_ends_with_a_status_and_a_sentence(here, identified, capsys):
    assert identified["fits"] is True
    capsys.readouterr()
    assert main([*IDENTIFY, "--chemistry", "nmc", "--current-sign", "discharge"]) == 1
    text = capsys.readouterr().out
    assert "The model does not fit these tests" in text
    assert "does not fit 'test': its voltage is off by" in text


def test_a_capacity_in_milliampere_hours_is_seen(here, refused):
    words = ["12000" if word == "12" else word for word in IDENTIFY]
    assert "is that in mAh? Then write 12" in refused(*words)


def test_the_report_shows_every_stage(identified, here):
    page = (here / "identify.html").read_text(encoding="utf-8")
    for part in ("Open-circuit voltage", "Resistances", "Fit of test", "Relaxation in test", "What was assumed"):
        assert part in page


def test_the_file_can_be_used_at_once(identified, as_json):
    found = as_json("soc", "day.csv", "--battery", "new.toml", "--truth", "soc_true", "--initial-soc", "0.9")
    assert found["soc_rmse"] < 0.03


def test_the_rc_model_of_a_drive_shows_its_elements(here, as_json, capsys):
    words = ("identify", "day.csv", "--capacity-ah", "12", "--model", "rc", "--initial-soc", "0.9", "--n-series", "3")
    found = as_json(*words, "-o", "rc.toml", "--report", "rc.html")["rc"]
    at_once = MODEL.r0_discharge_ohm[0]
    assert found["r0_ohm"] == pytest.approx(at_once, rel=0.3)
    assert found["dc_ohm"] > found["r0_ohm"] > found["r_terminal_ohm"] > 0.0
    assert "C_b" in (here / "rc.html").read_text(encoding="utf-8")
    assert main(words) == 0
    out = capsys.readouterr().out
    assert out.startswith("battery 'day': rc, 12 Ah given") and "R_0 + R_1, steady" in out
    assert "a straight line was taken" in out
    assert as_json("soc", "day.csv", "--battery", "rc.toml", "--truth", "soc_true", "--filter", "rc")["soc_rmse"] < 0.03


def test_text(here, capsys):
    assert main([*IDENTIFY, "--initial-soc", "1.0", "--idle-current", "-0.01"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("battery 'A': thevenin-1rc, 12 Ah given; identified in ")
    assert "Not identified:" in out
    assert "No battery file written" in out
    assert "(given, " in out
