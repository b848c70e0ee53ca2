"""Recordings of a CAN bus, written by python-can and asammdf, read by the database of the bus."""

import gc
import zlib
from pathlib import Path

import numpy as np
import pytest

from ohmward.errors import InputError
from ohmward.logs import FileHints, read_drive, read_log

can = pytest.importorskip("can")
pytest.importorskip("cantools")

#: The battery in two messages of which one has an extended identifier, and two drives whose signals have one name.
DBC = """VERSION ""
BU_: ECU
BO_ 854 Pack: 6 ECU
 SG_ pack_current : 0|16@1- (0.01,0) [-300|300] "A" ECU
 SG_ temperature : 16|16@1- (0.1,0) [-50|75] "degC" ECU
BO_ 2566868992 Volts: 4 ECU
 SG_ pack_voltage : 0|16@1+ (0.001,0) [0|65] "V" ECU
 SG_ flags : 16|16@1+ (1,0) [0|65535] "" ECU
BO_ 17 left_wheel: 2 ECU
 SG_ speed : 0|16@1- (0.1,0) [-3000|3000] "rpm" ECU
BO_ 18 right_wheel: 2 ECU
 SG_ speed : 0|16@1- (0.1,0) [-3000|3000] "rpm" ECU
"""
N = 400
START_S = 1_770_000_000.0
K = np.arange(N)
CURRENT_A = np.where(K % 40 < 20, -0.5, -8.25)
VOLTAGE_V = np.round(28.0 + 0.04 * CURRENT_A - 0.001 * K, 3)


def hints(folder: Path) -> FileHints:
    path = folder / "bus.dbc"
    path.write_text(DBC)
    return FileHints(dbc=str(path))


def frames():
    """A message of each kind, 10 ms apart, every tenth of a second; errors and one identifier nobody knows between."""
    for k in range(N):
        volts = round(1000 * VOLTAGE_V[k]).to_bytes(2, "little") + b"\x01\x00"
        amps = round(100 * CURRENT_A[k]).to_bytes(2, "little", signed=True) + (215).to_bytes(4, "little")
        wheels = [round(10 * speed).to_bytes(2, "little", signed=True) for speed in (0.1 * k, -0.2 * k)]
        for number, (identifier, payload) in enumerate(
            [(854, amps), (0x18FF5000, volts), (17, wheels[0]), (18, wheels[1]), (99, b"\0")]
        ):
            yield can.Message(
                timestamp=round(START_S + 0.1 * k + 0.01 * number, 3),
                arbitration_id=identifier,
                is_extended_id=identifier > 0x7FF,
                data=payload,
            )


def written(name: str, writer: str):
    def write(folder: Path) -> Path:
        path = folder / name
        with getattr(can, writer)(str(path)) as out:
            for frame in frames():
                out(frame)
        return path

    return write


def savvycan(folder: Path) -> Path:
    rows = ["Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8"]
    for frame in frames():
        cells = [f"{byte:02X}" for byte in frame.data] + [""] * (8 - len(frame.data))
        us = round(1e6 * (frame.timestamp - START_S))
        rows.append(
            f"{us},{frame.arbitration_id:08X},{str(frame.is_extended_id).lower()},Rx,0,{frame.dlc},{','.join(cells)}"
        )
    (folder / "log.csv").write_text("\n".join([*rows, ""]))
    return folder / "log.csv"


def canedge(folder: Path) -> Path:
    rows = ["TimestampEpoch;BusChannel;ID;IDE;DLC;DataLength;Dir;EDL;BRS;ESI;RTR;DataBytes"]
    for frame in frames():
        rows.append(
            f"{frame.timestamp:.6f};1;{frame.arbitration_id:03X};{int(frame.is_extended_id)};{frame.dlc};{frame.dlc};"
            f"0;0;0;0;0;{frame.data.hex().upper()}"
        )
    (folder / "edge.csv").write_text("\n".join([*rows, ""]))
    return folder / "edge.csv"


WRITERS = {
    "candump": written("bus.log", "CanutilsLogWriter"),
    "Vector ASC": written("bus.asc", "ASCWriter"),
    "Vector BLF": written("bus.blf", "BLFWriter"),
    "PEAK TRC": written("bus.trc", "TRCWriter"),
    "python-can": written("bus.csv", "CSVWriter"),
    "SavvyCAN": savvycan,
    "CANedge": canedge,
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_battery_in_two_messages(name, tmp_path):
    log = read_log(WRITERS[name](tmp_path), hints=hints(tmp_path))
    np.testing.assert_allclose(log.voltage_V[np.isfinite(log.voltage_V)], VOLTAGE_V)
    at = np.isfinite(log.voltage_V)
    np.testing.assert_allclose(log.time_s[at] - log.time_s[at][0], 0.1 * K, atol=2e-3)
    np.testing.assert_allclose(log.current_A[at][25:39], -8.25)
    np.testing.assert_allclose(log.measured()["temperature_degC"], 21.5)
    assert any("1 identifier not in" in note.text for note in log.notes)


@pytest.mark.parametrize("name", WRITERS)
def test_wheels_whose_signals_have_one_name(name, tmp_path):
    log = read_drive(WRITERS[name](tmp_path), ("left", "right"), 2, hints=hints(tmp_path))
    left, right = log.wheel_speed_rad_s.T
    np.testing.assert_allclose(left[np.isfinite(left)][5], 0.05 * 10 * np.pi / 30, rtol=0.1)
    assert np.nanmin(right) == pytest.approx(-0.2 * (N - 1) * np.pi / 30, rel=1e-3)


@pytest.mark.parametrize("name", WRITERS)
def test_without_the_database_the_error_names_the_one_beside(name, tmp_path):
    path = WRITERS[name](tmp_path)
    with pytest.raises(InputError, match=r"frames of a CAN bus.*--dbc FILE.dbc") as refused:
        read_log(path)
    assert refused.value.options == ()
    hints(tmp_path)
    with pytest.raises(InputError) as refused:
        read_log(path)
    assert refused.value.options == ("--dbc", str(tmp_path / "bus.dbc"))


@pytest.mark.parametrize("name", ["candump", "Vector BLF", "SavvyCAN"])
def test_another_database_and_none_are_refused(name, tmp_path):
    path = WRITERS[name](tmp_path)
    other = tmp_path / "other.dbc"
    other.write_text(
        DBC.replace("854", "855").replace("2566868992", "2566868993").replace(" 17 ", " 27 ").replace(" 18 ", " 28 ")
    )
    with pytest.raises(InputError, match="knows none of its frames"):
        read_log(path, hints=FileHints(dbc=str(other)))
    with pytest.raises(InputError, match="cannot be read"):
        read_log(path, hints=FileHints(dbc=str(tmp_path / "none.dbc")))
    other.write_bytes(bytes(range(200)))
    with pytest.raises(InputError, match="is no CAN database"):
        read_log(path, hints=FileHints(dbc=str(other)))


def test_frames_that_are_too_short_are_left_out_and_counted(tmp_path):
    path = WRITERS["candump"](tmp_path)
    lines = path.read_text().splitlines()
    lines[5] = lines[5][:-6]
    path.write_text("\n".join(lines))
    log = read_log(path, hints=hints(tmp_path))
    assert any("1 frame could not be decoded" in note.text and note.level == "warning" for note in log.notes)


def test_a_message_that_is_always_shorter_than_in_the_database_has_the_signals_that_fit(tmp_path):
    path = WRITERS["candump"](tmp_path)
    dbc = tmp_path / "longer.dbc"
    dbc.write_text(DBC.replace("Volts: 4", "Volts: 8").replace("flags : 16|16", "flags : 48|16"))
    log = read_log(path, hints=FileHints(dbc=str(dbc)))
    np.testing.assert_allclose(log.voltage_V[np.isfinite(log.voltage_V)], VOLTAGE_V)


def test_lines_of_candump_that_are_no_frames_are_left_out_and_counted(tmp_path):
    path = WRITERS["candump"](tmp_path)
    lines = path.read_text().splitlines()
    lines[6] = lines[6][:20]
    lines[51] = "read: Network is down"
    path.write_text("\n".join(lines))
    log = read_log(path, hints=hints(tmp_path))
    assert log.duration_s == pytest.approx(0.1 * (N - 1), abs=0.05)
    assert any("2 rows without a frame: left out" in note.text and note.level == "warning" for note in log.notes)


@pytest.mark.parametrize("name", ["candump", "SavvyCAN"])
def test_the_same_message_on_two_buses_is_asked_about(name, tmp_path):
    path = WRITERS[name](tmp_path)
    lines = path.read_text().splitlines()
    bus, other = {"candump": (f" {lines[0].split()[1]} ", " can1 "), "SavvyCAN": (",Rx,0,", ",Rx,1,")}[name]
    both = [each for line in lines for each in ([line, line.replace(bus, other)] if bus in line else [line])]
    path.write_text("\n".join(both))
    ending = other.strip(" ,").rpartition(",")[2]
    with pytest.raises(InputError, match=rf"2 batteries.* 'voltage=Volts of {ending}.pack_voltage \[V\]'"):
        read_log(path, hints=hints(tmp_path))
    chosen = {"voltage": f"Volts of {ending}.pack_voltage [V]", "current": f"Pack of {ending}.pack_current [A]"}
    log = read_log(path, hints=hints(tmp_path), columns=chosen, units={"voltage": "V", "current": "A"})
    np.testing.assert_allclose(log.voltage_V[np.isfinite(log.voltage_V)], VOLTAGE_V)


def test_two_messages_of_one_name_are_told_apart_by_their_identifiers(tmp_path, capfd):
    path = WRITERS["candump"](tmp_path)
    dbc = tmp_path / "twice.dbc"
    dbc.write_text(DBC.replace("right_wheel", "left_wheel"))
    with pytest.raises(InputError, match=r"left_wheel 11.speed.*left_wheel 12.speed"):
        read_drive(path, ("left", "right"), 2, hints=FileHints(dbc=str(dbc)))
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_recording_that_was_cut_off_gives_what_is_before_the_cut(share, tmp_path):
    path = WRITERS["Vector BLF"](tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    try:
        log = read_log(path, hints=hints(tmp_path), current_sign="charge")
    except InputError as error:
        assert "no readable recording of CAN" in str(error) or "holds no frame" in str(error)
    else:
        assert 0 < log.duration_s < 0.1 * N


@pytest.mark.parametrize("version", [1, 9])
def test_an_object_of_blf_without_a_length_ends_the_reading(version, tmp_path):
    """Its header says how far the next object is; of an unknown version it would be skipped, again and again."""
    path = WRITERS["Vector BLF"](tmp_path)
    content = path.read_bytes()
    container = content.index(b"LOBJ")
    objects = bytearray(zlib.decompress(content[container + 32 :]))
    half = objects.index(b"LOBJ", len(objects) // 2)
    objects[half + 6 : half + 12] = version.to_bytes(2, "little") + bytes(4)
    packed = zlib.compress(bytes(objects))
    size = len(packed) + 32
    header = content[container : container + 8] + size.to_bytes(4, "little") + content[container + 12 : container + 32]
    path.write_bytes(content[:container] + header + packed + bytes(size % 4))
    log = read_log(path, hints=hints(tmp_path))
    assert len(log) == N // 2
    assert "the file is damaged or cut off (an object of 0 bytes)" in str(log.notes)


def test_frames_in_mdf(tmp_path):
    pytest.importorskip("asammdf")
    path = written("bus.mf4", "MF4Writer")(tmp_path)
    with pytest.raises(InputError, match="--dbc"):
        read_log(path)
    log = read_log(path, hints=hints(tmp_path))
    np.testing.assert_allclose(log.voltage_V[np.isfinite(log.voltage_V)], VOLTAGE_V)


def test_rows_of_savvycan_that_are_no_frames_are_left_out_and_counted(tmp_path):
    """And identifiers such as 1E5, which other readers take for 100,000."""
    path = savvycan(tmp_path)
    lines = path.read_text().replace(",00000356,", ",000001E5,").splitlines()
    lines[2] = lines[2].replace("18FF5000", "18F[5000")
    lines[8] = lines[8][:20]
    path.write_text("\n".join(lines))
    dbc = tmp_path / "other.dbc"
    dbc.write_text(DBC.replace("BO_ 854", f"BO_ {0x1E5}"))
    log = read_log(path, hints=FileHints(dbc=str(dbc)))
    np.testing.assert_allclose(np.nanmin(log.current_A), -8.25)
    assert any("2 rows without a frame: left out" in note.text for note in log.notes)


@pytest.mark.parametrize(
    ("after", "claim"),
    [(0, (1 << 40).to_bytes(8, "little")), (20, (15 << 20).to_bytes(4, "little"))],
    ids=["records", "bytes of a record that say what is invalid"],
)
def test_a_group_of_mdf_that_says_it_holds_more_than_the_file_is_refused(tmp_path, after, claim):
    pytest.importorskip("asammdf")
    from logs.formats.recorders import mdf

    path = mdf(tmp_path)
    content = path.read_bytes()
    place = content.rindex(len(CURRENT_A[:300]).to_bytes(8, "little")) + after
    path.write_bytes(content[:place] + claim + content[place + len(claim) :])
    with pytest.raises(InputError, match="the MDF file is damaged"):
        read_log(path)


def test_a_channel_of_mdf_outside_its_record_is_refused(tmp_path):
    """asammdf would read the memory beside it, and crash now and then."""
    asammdf = pytest.importorskip("asammdf")
    from logs.formats.recorders import mdf

    path = mdf(tmp_path)
    with asammdf.MDF(str(path)) as file:
        place = file.groups[0].channels[-1].address + 92  # of the offset in the record, in a block of a channel
    content = path.read_bytes()
    assert content[place : place + 4] == (8).to_bytes(4, "little")
    path.write_bytes(content[:place] + (20_000).to_bytes(4, "little") + content[place + 4 :])
    with pytest.raises(InputError, match="damaged: 'PackCurrent' is outside its record"):
        read_log(path)


@pytest.mark.parametrize("magic", [b"MDF     ", b"UnFinMF "])
def test_a_file_of_mdf_that_cannot_be_read_leaves_neither_noise_nor_a_copy(tmp_path, monkeypatch, magic):
    pytest.importorskip("asammdf")
    from logs.formats.recorders import mdf

    content = bytearray(mdf(tmp_path).read_bytes()[:400])
    content[:8], content[60:62] = magic, int(magic.startswith(b"Un")).to_bytes(2, "little")
    path = tmp_path / "cut.mf4"
    path.write_bytes(content)
    noise: list[str] = []
    monkeypatch.setattr("sys.unraisablehook", lambda found: noise.append(str(found.exc_value)))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(InputError, match="no readable MDF file"):
        read_log(path)
    gc.collect()
    assert noise == []
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cut.mf4", "log.mf4"]
