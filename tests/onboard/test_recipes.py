"""The programs and the database of docs/recipes.md, with stand-ins for what they read."""

import json
import re
import sys
from types import SimpleNamespace

import pytest

from markdown_pages import ROOT

RECIPES = (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
(INA226,) = re.findall(r"^```python\n(.*?)^```", RECIPES, re.DOTALL | re.MULTILINE)


class OverError(Exception):
    """Nothing more to read."""


class OpenedOnce:
    """What a program opens in a `with`."""

    def __init__(self, *args, **kwargs):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass


def lines_of(program, monkeypatch, capsys, **modules):
    """JSON lines that a program prints until there is nothing more to read."""
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    with pytest.raises(OverError):
        exec(compile(program, "docs/recipes.md", "exec"), {})
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_the_ina226_is_read(monkeypatch, capsys):
    class Bus(OpenedOnce):
        left = 2

        def read_i2c_block_data(self, address, number, length):
            assert (address, length) == (0x40, 2)
            if number == 1:
                if not self.left:
                    raise OverError
                self.left -= 1
                return [0xF8, 0x30]  # -2000 steps of 2.5 uV: -5 mV at 2 mohm
            return [0x28, 0x00]  # 10240 steps of 1.25 mV

    found = lines_of(
        INA226, monkeypatch, capsys, smbus2=SimpleNamespace(SMBus=Bus), time=SimpleNamespace(sleep=lambda s: None)
    )
    assert found == [{"battery_current_A": pytest.approx(-2.5), "battery_voltage_V": pytest.approx(12.8)}] * 2


def test_the_answer_of_a_daly_is_read():
    cantools = pytest.importorskip("cantools")
    (text,) = re.findall(r"^```text\n(VERSION.*?)^```", RECIPES, re.DOTALL | re.MULTILINE)
    message = cantools.database.load_string(text, "dbc").get_message_by_frame_id(0x18904001)
    answer = bytes([0x00, 0x83, 0, 0, 0x75, 0x17, 0x03, 0x6C])  # 13.1 V, 25 of a tenth below 30000, 87.6 %
    assert message.decode(answer) == pytest.approx({"Voltage": 13.1, "Current": -2.5, "Charge": 87.6})
