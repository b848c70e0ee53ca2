import itertools
import math

import pytest

from ohmward.onboard import clock
from ohmward.onboard.clock import LONGEST_QUEUED_S, SETTLE_S, Arrivals
from ohmward.onboard.message import Message

LIVE_S, DELAY_S, OTHER_CLOCK_S = 100.0, 0.002, 57.3


def messages(publisher="", first_s=95.0, last_s=102.0, step_s=0.05):
    """Messages as (true time, message): those before `LIVE_S` come at once then, the others after a delay."""
    found = []
    for k in range(round((last_s - first_s) / step_s)):
        time_s = first_s + step_s * k
        received_s = max(time_s, LIVE_S + 1e-4 * k) + DELAY_S
        found.append((time_s, Message(time_s - OTHER_CLOCK_S, received_s, "source", {"x": time_s}, publisher)))
    return found


def put_all(arriving, sent):
    """Arrivals of messages in the order of their receipts."""
    in_order = sorted((message for _, message in sent), key=lambda message: message.received_s)
    return [arrival for message in in_order for arrival in arriving.put(message)]


def test_a_queue_at_the_connection_keeps_the_times_of_its_measurements():
    sent = messages()
    found = put_all(Arrivals(), sent)
    assert [a.time_s for a in found] == pytest.approx([true_s + DELAY_S for true_s, _ in sent], abs=1e-6)
    assert not any(a.clock_was_set for a in found)


def test_queues_of_several_publishers_leave_in_the_order_of_their_times():
    sent = messages("joints", step_s=0.05) + messages("imu", step_s=0.02)
    found = put_all(Arrivals(), sent)
    assert len(found) == len(sent)
    times = [a.time_s for a in found]
    assert times == sorted(times)


def test_messages_wait_no_longer_than_the_offset_needs():
    arriving = Arrivals()
    first = Message(1.0, LIVE_S, "source", {})
    assert arriving.put(first) == []
    assert arriving.due(LIVE_S + 0.9 * SETTLE_S) == []
    assert [a.message for a in arriving.due(LIVE_S + 1.01 * SETTLE_S)] == [first]
    assert len(arriving.put(first._replace(stamp_s=2.0, received_s=LIVE_S + 1.0))) == 1


def test_other_publishers_go_on_meanwhile():
    arriving = Arrivals()
    put_all(arriving, [pair for pair in messages("imu") if pair[0] < LIVE_S + 1.0])
    late = Message(5.0, LIVE_S + 1.0, "source", {}, "joints")
    assert arriving.put(late) == []
    assert len(arriving.put(Message(LIVE_S + 1.0 - OTHER_CLOCK_S, LIVE_S + 1.01, "source", {}, "imu"))) == 1


@pytest.mark.parametrize("message", [Message(math.nan, 7.0, "source", {}), Message(3.0, 7.0, "own", {})])
def test_what_has_no_clock_of_its_own_never_waits(message):
    assert [a.time_s for a in Arrivals(frozenset({"own"})).put(message)] == [7.0]


def test_a_queue_without_end_is_let_through():
    """Stamps that run at ten times the rate, of a recording that is played."""
    arriving = Arrivals()
    found = [arriving.put(Message(k, 0.1 * k, "source", {})) for k in range(200)]
    assert sum(map(len, found)) == 200
    assert all(len(several) == 1 for several in found[round(LONGEST_QUEUED_S / 0.1) + 2 :])


def test_most_messages_wait(monkeypatch):
    monkeypatch.setattr(clock, "MOST_QUEUED", 50)
    arriving = Arrivals()
    assert [len(arriving.put(Message(k, 1e-4 * k, "source", {}))) for k in range(50)] == [0] * 49 + [50]


def test_two_senders_whose_clocks_differ_do_not_hold_each_other_up():
    arriving = Arrivals()
    found = [arriving.put(Message(0.1 * k - 50.0 * (k % 2), 0.1 * k, "source", {})) for k in range(200)]
    assert sum(map(len, found)) == 200
    assert all(len(several) == 1 for several in found[round(LONGEST_QUEUED_S / 0.1) + 2 :])


def test_a_source_that_invents_publishers_shares_a_clock_for_them(monkeypatch):
    monkeypatch.setattr(clock, "MOST_CLOCKS", 10)
    arriving = Arrivals()
    for k in range(100):
        arriving.put(Message(1.0 + 0.1 * k, 5.0 + 0.1 * k, "mqtt", {}, f"topic/{k}"))
    assert len(arriving._clocks) == 11


def test_what_waits_at_the_end_is_not_lost():
    arriving = Arrivals()
    sent = [pair for pair in messages() if pair[0] < LIVE_S]
    assert put_all(arriving, sent) == []
    found = arriving.flush()
    assert [b.time_s - a.time_s for a, b in itertools.pairwise(found)] == pytest.approx([0.05] * 99)
