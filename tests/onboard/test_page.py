"""The live page: what it says, whom it lets in, and that no reader holds it up."""

import asyncio
import http.client
import json
import math
import shutil
import ssl
import subprocess
import urllib.error
import urllib.parse
import urllib.request

import numpy as np
import pytest

from ohmward import __version__, generic_battery
from ohmward.energy.mission import EXAMPLE, PLAN_FILE
from ohmward.energy.points import Quantiles
from ohmward.energy.range_step import RangeEstimate
from ohmward.errors import InputError, OhmwardError
from ohmward.onboard.alarms import AlarmLimits, AlarmWatch
from ohmward.onboard.estimation import Estimation
from ohmward.onboard.feed import Feed
from ohmward.onboard.page.app import MOST_READERS, make_app
from ohmward.onboard.page.dashboard import POINTS, ROWS, SPANS, Dashboard
from ohmward.onboard.page.metrics import metrics
from ohmward.onboard.page.view import ELLIPSE_95, HISTORY, advice, ellipse, largest, view
from ohmward.onboard.robot_state import Level, RobotState
from ohmward.onboard.secrets import is_loopback
from ohmward.onboard.sinks.page import PageSink
from ohmward.onboard.store.rows import RowMaker
from ohmward.traction.robot.packaged import load_robot
from ohmward.traction.speed_observer.estimate import SlipFlag
from onboard.page_server import TOKEN, drive, filled_dashboard, served
from onboard.ros.test_messages import charge, driven


@pytest.fixture(scope="module")
def page():
    with served() as address:
        yield address


@pytest.fixture(scope="module")
def locked():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OHMWARD_TEST_TOKEN", TOKEN)
        with served(token=TOKEN) as address:
            yield address


def get(url, method="GET", data=None, **headers):
    """Status, headers and text of an answer; redirections are not followed."""
    request = urllib.request.Request(url, data=data, headers=headers, method=method)
    opener = urllib.request.build_opener(_NoRedirect)
    try:
        with opener.open(request, timeout=60) as answer:
            return answer.status, answer.headers, answer.read().decode()
    except urllib.error.HTTPError as answer:
        return answer.code, answer.headers, answer.read().decode()


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, *_):
        return None


def test_the_view_has_bands_power_and_wheels_by_name():
    state = drive()[-1]._replace(sample={"battery_current_A": -3.0, "battery_voltage_V": 13.0, **drive()[-1].sample})
    shown = view(state)
    assert shown["charge"]["low"] < shown["charge"]["soc"] < shown["charge"]["high"]
    assert shown["charge"]["soh_capacity_band"] > 0.0 and shown["charge"]["resistance_ratio_band"] > 0.0
    assert [wheel["name"] for wheel in shown["drive"]["wheels"]] == ["front_left", "front_right"]
    power = shown["power"]
    assert power["battery_W"] == pytest.approx(39.0)
    assert power["motion_W"] + power["slip_W"] + power["rest_W"] == pytest.approx(39.0)
    assert shown["level"] == "WARN"
    json.dumps(shown, allow_nan=False)


def test_a_range_says_whether_the_charge_is_known():
    state = drive()[-1]
    quantiles = Quantiles(65.0, 1300.0, 3000.0)
    reach = RangeEstimate(quantiles, quantiles, quantiles, quantiles, 0.9, 10.0, 0)
    assert state.battery is not None
    known = state._replace(range=reach, battery=state.battery._replace(soc=0.5, soc_std=0.02))
    assert view(known)["range"]["charge_known"] is True
    unknown = known._replace(battery=state.battery._replace(soc=0.5, soc_std=0.25))
    assert view(unknown)["range"]["charge_known"] is False


def test_power_has_no_parts_without_motor_currents():
    state = drive()[-1]
    assert state.slip is not None
    blind = state._replace(slip=state.slip._replace(flags=int(SlipFlag.NO_CURRENT)))
    assert set(view(blind)["power"]) == {"battery_W"}


def test_wheels_keep_their_names_when_an_encoder_falls_silent():
    """Page and store: the names are those of the robot file, whatever signals a sample has."""
    robot = load_robot("rlma")
    names, estimation = [place.name for place in robot.places], Estimation(None, robot)
    for k in range(120):
        there = {f"wheel_speed_rad_s.{name}": 3.0 for name in names if k < 60 or name != "front_left"}
        states = estimation.put(0.01 * k, there | {"yaw_rate_rad_s": 0.0})
    driven = names[: robot.driven]
    assert [wheel["name"] for wheel in view(states[-1])["drive"]["wheels"]] == driven
    (row,) = RowMaker().rows(states[-1]._replace(unix_s=1.8e9))
    assert {name for name in row.values if name.startswith("slip_ratio")} <= {f"slip_ratio.{name}" for name in driven}


def test_the_ellipse_holds_95_percent():
    cov = np.array([[0.05, 0.02, 0.0], [0.02, 0.03, 0.0], [0.0, 0.0, 0.1]])
    found = ellipse(cov)
    points = np.random.default_rng(1).multivariate_normal([0, 0], cov[:2, :2], 100_000)
    c, s = math.cos(found["angle_rad"]), math.sin(found["angle_rad"])
    along, across = points @ [c, s], points @ [-s, c]
    inside = (along / found["major_m"]) ** 2 + (across / found["minor_m"]) ** 2 <= 1.0
    assert inside.mean() == pytest.approx(0.95, abs=0.003)
    assert found["major_m"] >= found["minor_m"]
    assert pytest.approx(2.4477, abs=1e-4) == ELLIPSE_95


def test_the_largest_slip_is_that_of_either_sign():
    assert largest(np.array([0.1, -0.3, math.nan])) == -0.3
    assert math.isnan(largest(np.array([math.nan])))


def test_history_and_path_are_bounded():
    dashboard, state = Dashboard("rover"), drive()[-1]
    assert state.pose is not None
    for k in range(3 * ROWS):
        pose = state.pose._replace(x_m=0.1 * k)
        dashboard.take([state._replace(time_s=float(k), unix_s=float(k), pose=pose)])
    history = dashboard.history()
    assert set(history) == set(HISTORY) and len(history["unix_s"]) == ROWS
    assert len(dashboard.path) <= POINTS
    assert dashboard.path[0] == (0.0, pytest.approx(state.pose.y_m))
    assert len(dashboard.history(3 * ROWS - 11.0)["soc"]) == 10


def test_a_clock_that_was_set_back_does_not_stop_the_history():
    dashboard, state = Dashboard("rover"), drive()[-1]
    dashboard.take([state._replace(time_s=1000.0)])
    dashboard.take([state._replace(time_s=10.0)])
    assert len(dashboard.history()["soc"]) == 2


def test_rows_of_dates_that_have_not_come_yet_are_dropped():
    """The wall clock is set back by 20 minutes while the robot drives on."""
    dashboard, state = Dashboard("rover"), drive()[-1]
    for k in range(90):
        unix_s = 6000.0 + 60.0 * k - (1230.0 if k >= 60 else 0.0)
        dashboard.take([state._replace(time_s=60.0 * k, unix_s=unix_s)])
    before, after = [6000.0 + 60.0 * k for k in range(40)], [8370.0 + 60.0 * k for k in range(30)]
    assert dashboard.history()["unix_s"] == [*before, *after]


@pytest.mark.parametrize("level", [Level.ERROR, Level.STALE])
def test_the_value_of_a_stuck_or_silent_sensor_is_not_shown(level):
    dashboard = filled_dashboard()
    useless = drive()[-1].diagnostics[1]._replace(level=level)
    dashboard.take([drive()[-1]._replace(diagnostics=(useless,), sample={})])
    assert dashboard.view()["charge"]["voltage_V"] is None
    assert dashboard.view()["charge"]["current_A"] == -3.0


def test_a_feed_that_leaves_states_out_keeps_their_measurements():
    async def collected():
        feed = Feed(0.35)
        for state in drive():
            feed.put(state)
        feed.end()
        return await feed.batch()

    states = asyncio.run(collected())
    assert len(states) < len(drive()) / 4
    assert all("battery_voltage_V" in s.sample and "yaw_rate_rad_s" in s.sample for s in states[1:])


def test_metrics_are_whole_lines_with_their_robot():
    text = metrics(filled_dashboard().view())
    assert 'ohmward_soc_ratio{robot="rover <1>"} 0.' in text
    assert 'ohmward_slip_ratio{robot="rover <1>",wheel="front_left"}' in text
    assert 'ohmward_condition{robot="rover <1>",name="battery_voltage_V"} 1' in text
    names = [line.split()[2] for line in text.splitlines() if line.startswith("# TYPE")]
    assert len(names) == len(set(names))
    assert metrics({"name": "new"}) == "\n"


@pytest.mark.parametrize(
    "path", ["/", "/page.js", "/charts.js", "/page.css", "/palette.css", "/uPlot.js", "/uPlot.css"]
)
def test_every_file_of_the_page_is_served_with_safe_headers(page, path):
    status, headers, text = get(page + path)
    assert status == 200 and text
    assert "default-src 'none'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"


def test_the_page_asks_nobody_else(page):
    texts = [get(page + path)[2] for path in ("/", "/page.js", "/charts.js", "/page.css", "/palette.css")]
    assert not any("//" in text.replace("http://www.w3.org/2000/svg", "").replace("// ", "") for text in texts)


def test_the_api_says_what_is_known(page):
    assert json.loads(get(page + "/api/now")[2])["name"] == "rover <1>"
    assert json.loads(get(page + "/api/state")[2])["battery"]["soc"] > 0.3
    assert len(json.loads(get(page + "/api/history")[2])["unix_s"]) > 3
    assert json.loads(get(page + "/api/history?since=2e9")[2])["unix_s"] == []
    assert get(page + "/api/history?since=now")[0] == 400
    assert json.loads(get(page + "/api/path")[2])["x_m"]


@pytest.fixture(scope="module")
def asked():
    """The page of a robot that can be asked for missions, half full, and its estimators."""
    estimation = Estimation(generic_battery("lfp", 12.0, 4), load_robot("rlma"))
    estimation.put(0.0, {"battery_current_A": -3.0, "battery_voltage_V": 13.2})
    estimation.put(1.0, {"battery_current_A": -3.0, "battery_voltage_V": 13.2})
    with served(dashboard=Dashboard("rover", mission=estimation.mission)) as address:
        yield address + "/api/mission?", estimation


def test_a_mission_is_judged_before_it_begins(asked):
    address, estimation = asked
    near, far = (json.loads(get(f"{address}distance_m={d}")[2]) for d in (100, 20_000))
    assert near["probability"] > 0.9 > far["probability"] and near["distance_m"] == pytest.approx(100.0)
    tool = json.loads(get(f"{address}distance_m=100&task_J=50000")[2])
    assert tool["energy_J"]["p50"] - near["energy_J"]["p50"] == pytest.approx(50e3, rel=1e-3)
    plan = urllib.parse.quote(EXAMPLE)
    found = json.loads(get(f"{address}plan={plan}&reserve_soc=0.2")[2])
    legs = PLAN_FILE.parse(EXAMPLE).legs
    assert found["probability"] == estimation.mission(legs, 0.0, 0.2).probability
    assert len(found["milestones"]) == len(legs)


@pytest.mark.parametrize(
    ("query", "error"),
    [
        ("", "give distance_m=METRES, or plan=TEXT"),
        ("distance_m=1&plan=x", "give distance_m=METRES, or plan=TEXT"),
        ("distance_m=nan", "distance_m must be a number from 0 to 1e+06, got 'nan'"),
        ("distance_m=0", "the plan takes no time"),
        ("distance_m=9&reserve_soc=0.9", "reserve_soc must be below soc"),
        ("plan=x", "plan: is not valid TOML"),
    ],
)
def test_a_mission_that_cannot_be_is_refused(asked, query, error):
    status, _, text = get(asked[0] + query)
    assert status == 409 and error in json.loads(text)["error"]


def test_no_mission_is_judged_while_the_battery_is_silent(page):
    assert "the charge is not known" in json.loads(get(page + "/api/mission?distance_m=9")[2])["error"]


def test_the_description_names_what_the_api_answers(page):
    found = json.loads(get(page + "/openapi.json")[2])
    assert found["info"]["version"] == __version__

    def names(path):
        return list(
            found["paths"][path]["get"]["responses"]["200"]["content"]["application/json"]["schema"]["properties"]
        )

    assert names("/api/state") == list(RobotState._fields)
    assert names("/api/history") == list(HISTORY)
    assert found["paths"]["/api/history"]["get"]["parameters"][1]["schema"]["enum"] == list(SPANS)


def test_nothing_takes_a_command(page):
    for path in json.loads(get(page + "/openapi.json")[2])["paths"]:
        for method in ("POST", "PUT", "DELETE", "PATCH"):
            assert get(page + path, method, data=b"{}")[0] == 405


def test_a_page_elsewhere_cannot_read_it_through_a_browser(page):
    assert get(page + "/api/now", Host="evil.example")[0] == 421
    assert get(page + "/api/now", Host="evil.example:8080")[0] == 421
    assert get(page + "/api/now", Host="localhost:8080")[0] == 200


def test_without_the_token_nobody_reads(locked):
    for path in ("/api/now", "/api/history", "/metrics", "/events", "/openapi.json", "/page.js"):
        assert get(locked + path)[0] == 401
        assert get(locked + path, Authorization="Bearer wrong")[0] == 401
    assert get(locked + "/api/now", Authorization=f"Bearer {TOKEN}", Host="rover.local")[0] == 200


def test_the_login_gives_a_cookie_that_is_not_the_token(locked):
    status, headers, _ = get(locked + "/", Accept="text/html")
    assert (status, headers["location"]) == (303, "/login")
    assert "password" in get(locked + "/login")[2]
    status, _, text = get(locked + "/login", "POST", b"token=wrong")
    assert status == 401 and "not the token" in text
    status, headers, _ = get(locked + "/login", "POST", b"token=" + TOKEN.replace(" ", "+").encode())
    cookie = headers["set-cookie"]
    assert status == 303 and "HttpOnly" in cookie and "SameSite=strict" in cookie and TOKEN not in cookie
    assert get(locked + "/api/now", Cookie=cookie.partition(";")[0])[0] == 200
    assert get(locked + "/api/now", Cookie="ohmward_token=guess")[0] == 401


def test_events_carry_the_newest_state(page):
    with urllib.request.urlopen(page + "/events", timeout=60) as stream:
        assert stream.readline() == b"retry: 1000\n"
        stream.readline()
        assert json.loads(stream.readline().removeprefix(b"data: "))["name"] == "rover <1>"


def ask_for_events(app, waiting):
    """A reader of events that never reads: the first message to it goes into `waiting`."""

    async def never(message):
        waiting.append(message)
        await asyncio.Event().wait()

    scope = {"type": "http", "method": "GET", "path": "/events", "query_string": b"", "headers": []}
    return asyncio.ensure_future(app(scope, _silence, never))


def test_readers_that_do_not_read_hold_nobody_up():
    async def delivered():
        dashboard = Dashboard("rover")
        app = make_app(dashboard)
        waiting: list[dict[str, int]] = []
        readers = [ask_for_events(app, waiting) for _ in range(MOST_READERS + 10)]
        await asyncio.sleep(0.05)
        for state in drive():
            dashboard.take([state])
            await asyncio.sleep(0)
        for reader in readers:
            reader.cancel()
        return [message["status"] for message in waiting]

    statuses = asyncio.run(asyncio.wait_for(delivered(), 60.0))
    assert (statuses.count(200), statuses.count(503)) == (MOST_READERS, 10)


def test_readers_that_go_make_room_for_others():
    async def statuses():
        app = make_app(Dashboard("rover"))
        waiting: list[dict[str, int]] = []
        for _ in range(2):
            readers = [ask_for_events(app, waiting) for _ in range(MOST_READERS)]
            await asyncio.sleep(0.05)
            for reader in readers:
                reader.cancel()
            await asyncio.gather(*readers, return_exceptions=True)
        return {message["status"] for message in waiting}

    assert asyncio.run(statuses()) == {200}


async def _silence():
    await asyncio.Event().wait()


def test_a_network_is_refused_without_a_token():
    with pytest.raises(InputError, match=r"could be read by the whole network; give token"):
        PageSink(host="0.0.0.0")
    assert PageSink(host="0.0.0.0", token="ROBOT_TOKEN").token == "ROBOT_TOKEN"
    assert is_loopback("::1") and is_loopback("localhost") and not is_loopback("rover.local")


def test_a_certificate_goes_with_its_key():
    with pytest.raises(InputError, match="go together"):
        PageSink(certificate="robot.pem")


@pytest.fixture(scope="module")
def tls(tmp_path_factory):
    """Paths of a certificate for 127.0.0.1 that signs itself, its key, and the key of another one."""
    if not shutil.which("openssl"):
        pytest.skip("needs openssl")
    folder = tmp_path_factory.mktemp("tls")
    for name in ("robot", "other"):
        words = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2", "-subj", "/CN=robot"]
        files = ["-keyout", f"{name}.key", "-out", f"{name}.pem", "-addext", "subjectAltName=IP:127.0.0.1"]
        subprocess.run(["openssl", "req", "-x509", *words, *files], cwd=folder, check=True, capture_output=True)
    subprocess.run(
        ["openssl", "ec", "-in", "robot.key", "-out", "locked.key", "-aes256", "-passout", "pass:secret"],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    return {name: str(folder / name) for name in ("robot.pem", "robot.key", "other.key", "locked.key")}


def test_a_certificate_is_served(tls):
    with served(certificate=tls["robot.pem"], key=tls["robot.key"]) as address:
        trusting = ssl.create_default_context(cafile=tls["robot.pem"])
        with urllib.request.urlopen(address + "/api/now", timeout=60, context=trusting) as answer:
            assert json.load(answer)["name"] == "rover <1>"
        assert address.startswith("https://")


@pytest.mark.parametrize(
    ("certificate", "key", "message"),
    [
        ("robot.key", "robot.pem", r"swapped; certificate = \".*robot.pem\", key = \".*robot.key\""),
        ("robot.pem", "other.key", r"KEY_VALUES_MISMATCH\); give a certificate and the key that belongs to it"),
        ("robot.pem", "locked.key", "without a passphrase"),
    ],
)
def test_a_certificate_that_cannot_serve_is_said_with_the_fix(tls, certificate, key, message):
    sink = PageSink(port=0, certificate=tls[certificate], key=tls[key])
    with pytest.raises(OhmwardError, match=message):
        asyncio.run(sink.run(Feed()))


def test_files_that_are_no_certificate_are_said(tmp_path):
    (tmp_path / "robot.pem").write_text("nothing")
    names = str(tmp_path / "robot.pem"), str(tmp_path / "robot.key")
    with pytest.raises(OhmwardError, match=r"robot.key is no file; give the paths"):
        asyncio.run(PageSink(port=0, certificate=names[0], key=names[1]).run(Feed()))
    (tmp_path / "robot.key").write_text("nothing")
    with pytest.raises(OhmwardError, match="TLS cannot begin with certificate"):
        asyncio.run(PageSink(port=0, certificate=names[0], key=names[1]).run(Feed()))


def test_a_token_of_any_letters_opens_the_page(monkeypatch):
    token = "Schlüssel №1"
    monkeypatch.setenv("OHMWARD_TEST_TOKEN", token)
    with served(token=token) as address:
        connection = http.client.HTTPConnection(address.removeprefix("http://"), timeout=60)
        connection.request("GET", "/api/now", headers={"Authorization": f"Bearer {token}".encode()})
        assert connection.getresponse().status == 200
        connection.close()
        form = urllib.parse.urlencode({"token": token}).encode()
        assert get(address + "/login", "POST", form)[0] == 303
        assert get(address + "/api/now", Authorization="Bearer Schl\xfcssel")[0] == 401


def test_a_port_that_is_taken_is_named(page):
    port = int(page.rpartition(":")[2])
    with pytest.raises(OhmwardError, match=rf"port {port} of 127.0.0.1 cannot be listened at"):
        asyncio.run(PageSink(port=port).run(Feed()))


def test_the_sink_ends_with_its_feed():
    async def run():
        feed = Feed()
        for state in drive():
            feed.put(state)
        feed.end()
        await asyncio.wait_for(PageSink(port=0).run(feed), 60)

    asyncio.run(run())


@pytest.mark.parametrize(
    ("soc", "std", "current_A", "sentence"),
    [
        (0.6, 0.05, -3.0, ""),
        (0.3, 0.09, -3.0, "Drive home now: the battery may be down to 12 %."),
        (0.3, 0.14, -3.0, "Charge now: the battery may be nearly empty."),
        (0.3, 0.14, 2.0, ""),
        (0.5, 0.25, -3.0, "The charge is not known: charge the battery fully once."),
    ],
)
def test_an_operator_is_told_what_to_do_by_the_low_end_of_the_band(soc, std, current_A, sentence):
    state = driven()._replace(battery=charge(soc)._replace(soc_std=std), sample={"battery_current_A": current_A})
    state = state._replace(alarms=AlarmWatch(AlarmLimits(after_s=0.0)).take(state))
    assert advice(state) == view(state)["advice"] == sentence


def test_an_operator_is_told_of_the_wheel_that_turns_on_the_spot():
    state = driven()
    assert state.slip is not None
    stuck = state.slip._replace(immobilised=1.0, slip_speed_m_s=np.array([0.1, -0.9]))
    (alarm,) = AlarmWatch(AlarmLimits(after_s=0.0)).take(
        state._replace(slip=stuck, wheels=("front_left", "front_right"))
    )
    assert alarm.text == "Stop and look at the front right wheel: it turns and the robot does not move."


def test_the_cells_are_shown_by_their_extremes():
    estimation = Estimation(generic_battery("lfp", 12.0, 4))
    values = {"battery_current_A": -3.0, "battery_voltage_V": 13.0}
    for k in range(30):
        cells = {f"cell_voltage_V.{n}": 3.25 + 0.01 * n for n in range(4)}
        estimation.put(0.1 * k, values | cells)
    seen = view(estimation.state._replace(sample=values | cells))["charge"]["beside"]
    assert [(one["label"], one["value"]) for one in seen[:2]] == [
        ("Lowest cell, number 1", 3.25),
        ("Highest cell, number 4", pytest.approx(3.28)),
    ]
    assert seen[2]["label"] == "Between their charges" and seen[2]["value"] > 0.0
