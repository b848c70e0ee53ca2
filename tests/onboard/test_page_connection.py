"""Connections to the live page whose clients are slow, silent, rude or too many."""

import http.client
import socket
import time

import pytest

from ohmward.onboard.page import connection
from onboard.page_server import TOKEN, served

GET = b"GET /api/now HTTP/1.1\r\nHost: 127.0.0.1\r\n"


@pytest.fixture
def port(monkeypatch):
    """Of a page whose patience is a fifth of a second."""
    monkeypatch.setattr(connection, "REQUEST_S", 0.2)
    monkeypatch.setattr(connection, "READ_S", 0.2)
    monkeypatch.setattr(connection, "MOST_CONNECTIONS", 5)
    with served() as address:
        yield int(address.rpartition(":")[2])


def client(port):
    return socket.create_connection(("127.0.0.1", port), timeout=60.0)


def is_closed(one):
    """True where the other side has closed the connection without a word."""
    try:
        return one.recv(1) == b""
    except ConnectionError:
        return True


def status(one):
    return one.recv(4096)[9:12]


def test_who_does_not_ask_is_closed(port):
    with client(port) as silent, client(port) as slow:
        slow.sendall(GET)
        assert is_closed(silent)
        assert is_closed(slow)


def test_who_asks_again_slowly_is_closed_and_who_asks_is_not(port):
    one = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    for _ in range(3):
        one.request("GET", "/api/now")
        answer = one.getresponse()
        assert answer.status == 200
        answer.read()
        time.sleep(0.15)
    one.sock.sendall(GET)
    assert is_closed(one.sock)
    one.close()


def test_one_too_many_is_closed_and_has_room_later(port):
    with client(port) as sixth_before:
        ones = [client(port) for _ in range(4)]
        time.sleep(0.05)
        with client(port) as sixth:
            assert is_closed(sixth)
        for one in ones:
            one.close()
        assert is_closed(sixth_before)
    time.sleep(0.05)
    with client(port) as one:
        one.sendall(GET + b"\r\n")
        assert status(one) == b"200"


def test_who_does_not_read_is_closed(port):
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        one.connect(("127.0.0.1", port))
        one.settimeout(60.0)
        script = b"GET /uPlot.js HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
        with pytest.raises(ConnectionError):
            for _ in range(1000):
                one.sendall(script)
                time.sleep(0.01)


def test_a_login_without_its_body_and_a_body_that_is_broken(monkeypatch, caplog):
    monkeypatch.setenv("OHMWARD_TEST_TOKEN", TOKEN)
    monkeypatch.setattr("ohmward.onboard.page.app.REQUEST_S", 0.2)
    with served(token=TOKEN) as address:
        port = int(address.rpartition(":")[2])
        with client(port) as one:
            one.sendall(b"POST /login HTTP/1.1\r\nHost: a\r\nContent-Length: 100\r\n\r\ntoken=")
            assert status(one) == b"408"
        with client(port) as gone:
            gone.sendall(b"POST /login HTTP/1.1\r\nHost: a\r\nContent-Length: 100\r\n\r\ntoken=")
        with client(port) as broken:
            broken.sendall(b"POST /login HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n")
            assert status(broken) == b"400"
        time.sleep(0.1)
    assert not caplog.records


@pytest.mark.parametrize(("request_line", "answer"), [("POST /api/now", b"405"), ("GET /events", b"200")])
def test_a_body_that_is_broken_after_its_answer_has_begun_ends_the_connection(port, caplog, request_line, answer):
    with client(port) as one:
        one.sendall(f"{request_line} HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\n".encode())
        assert status(one) == answer
        one.sendall(b"zz\r\n")
        while one.recv(1 << 16):
            pass
    assert not [record for record in caplog.records if record.levelname == "ERROR"]
