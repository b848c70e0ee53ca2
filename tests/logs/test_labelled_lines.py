"""Lines that name each of their numbers."""

import pytest

from ohmward.logs.objects_file import is_labelled, rows_of_lines


@pytest.mark.parametrize(
    ("line", "row"),
    [
        ("m v=1.5,n=5i,u=7u 12", {"time": 12, "v": 1.5, "n": 5.0, "u": 7.0}),
        (r"m,robot=r\ 1,a\,b=c v=1 12", {"time": 12, "robot": "r 1", "a,b": "c", "v": 1.0}),
        ('m text="a \\"b\\", c=d",v=-1e-3', {"text": 'a "b", c=d', "v": -1e-3}),
        ("voltage value=12.5 7", {"time": 7, "voltage": 12.5}),
        ("m v=12026-02-303.036,on=true 12", {"time": 12, "v": "12026-02-303.036", "on": "true"}),
        ("V:12.3,I:-1.2", {"V": 12.3, "I": -1.2}),
        ("volts = 12.3 V; amps = -1.2 A", {"volts [V]": 12.3, "amps [A]": -1.2}),
        ("09:15:00.123 -> V:12.3 I:-1.2", {"time": "09:15:00.123", "V": 12.3, "I": -1.2}),
        ("[09:15:00.123] V=12.3V I=-1.2A", {"time": "09:15:00.123", "V [V]": 12.3, "I [A]": -1.2}),
        ("2026-03-28T09:15:00Z V: 12.3 I: -1.2", {"time": "2026-03-28T09:15:00Z", "V": 12.3, "I": -1.2}),
        ("[   12.345] bms: volts: 12.3 V, amps: -1.2 A", {"time": "12.345", "volts [V]": 12.3, "amps [A]": -1.2}),
        ("2026-03-28 09:15:00 INFO bat: V=12.3 I=-1.2", {"time": "2026-03-28 09:15:00", "V": 12.3, "I": -1.2}),
        ("2026-03-28 09:15:00,123 - bat - INFO - V=1 I=2", {"time": "2026-03-28 09:15:00.123", "V": 1.0, "I": 2.0}),
        ("ts=2026-03-28T09:15:00Z level=info V=12.3 I=-1.2", {"time": "2026-03-28T09:15:00Z", "V": 12.3, "I": -1.2}),
    ],
)
def test_a_line_is_a_row(line, row):
    assert rows_of_lines(f"{line}\nanything else\n") == [row]
    assert is_labelled(f"{line}\n{line}\n{line}\n".encode())


@pytest.mark.parametrize("line", ["time,current,voltage", "1,2,3", "key: value", "2026-01-31 12:00:00,1.5,12.5", "a=1"])
def test_other_lines_are_none(line):
    assert not is_labelled(f"{line}\n{line}\n{line}\n".encode())
