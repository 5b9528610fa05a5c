"""The page's own wire: what it is told, who may connect, and what a hostile client can do to it."""

import os
import random
import re
import socket
import time

import pytest

from haltere_testing.rig import Rig, free_port
from sockets import Refused, WebSocket, get, http


def status_of(*args, **more):
    try:
        WebSocket(*args, **more).close()
        return 101
    except Refused as refused:
        return refused.status


def test_the_page_loads_nothing_from_elsewhere(rig, port):
    status, head, page = get(port)
    assert status == 200 and "Content-Security-Policy: default-src 'none'" in head
    for path in ("/", "/watch.css", "/watch.js"):
        status, head, text = get(port, path)
        assert status == 200 and len(text) > 500, path
        assert not re.search(r"(https?:)?//[a-z0-9]", text.replace("// ", "")), path
    assert get(port, "/etc/passwd")[0] == get(port, "/../Cargo.toml")[0] == 404
    assert http(port, b"POST / HTTP/1.1\r\nHost: x\r\n\r\n").startswith(b"HTTP/1.1 405")


def test_it_shows_the_flight_as_it_is(rig, port, station):
    # The station hears of the end of the take-off before the page's thread looks.
    rig.pass_time(1.0)
    with WebSocket(port) as page:
        hello = page.wait(lambda m: m["k"] == "hello")
        assert len(hello["anchors"]) == 8 and hello["anchors"][7]["p"] == [10.0, 10.0, 7.0]
        assert any("take-off height reached" in e["text"] for e in hello["events"])
        assert len(hello["trail"]) > 20
        station.goto(5.8, 5.4, 1.4)
        rig.wait(lambda: rig.distance(5.8, 5.4) < 0.3)
        event = page.wait(lambda m: m["k"] == "e")
        assert "goto" in event["events"][0]["text"], event
    with WebSocket(port) as page:
        frame = page.wait(lambda m: m["k"] == "f")
        truth = rig.truth()
        assert abs(frame["p"][0] - truth["pos_E_x_m"]) < 0.5, (frame, truth)
        assert abs(frame["p"][1] - truth["pos_E_y_m"]) < 0.5
        assert abs(frame["p"][2] + truth["pos_E_z_m"]) < 0.5
        wanted = (5.8, 5.4, 1.4)
        assert max(abs(a - b) for a, b in zip(frame["sp"], wanted)) < 0.35, frame
        assert frame["armed"] and frame["health"] in ("good", "degraded")
        assert 0.3 < frame["dop"] < 5 and all(0 < s < 1 for s in frame["std"])
        slow = page.wait(lambda m: m["k"] == "s")
        assert {a["id"] for a in slow["anchors"]} == set(range(8)), slow
        assert all(a["used"] > 0.3 and a["hz"] > 5 for a in slow["anchors"]), slow
        assert 6.0 < slow["battery"]["v"] < 9.0 and slow["uwb_delay"]["mean"] < 0.3
        cuts = hello["cuts"]
        assert len(cuts["plan"]) == len(cuts["side"]) == cuts["places"] ** 2


def test_it_is_live_at_ten_hertz_or_more(rig, port):
    with WebSocket(port) as page:
        page.wait(lambda m: m["k"] == "f")
        began, apart_s = time.monotonic(), []
        for _ in range(30):
            page.wait(lambda m: m["k"] == "f")
            apart_s.append(time.monotonic() - began)
            began = time.monotonic()
        # It sends 25; the issue asks for 10. The middle one: a machine that stands still for a moment is
        # no matter of the page.
        assert sorted(apart_s)[15] < 0.1, apart_s


def test_an_echo_measures_the_way(rig, port):
    with WebSocket(port) as page:
        page.send("p12.5")
        deadline = time.monotonic() + 5
        while page.receive() != "p12.5":
            assert time.monotonic() < deadline


def test_pages_of_other_sites_and_other_names_for_us_are_refused(rig, port):
    own = f"http://127.0.0.1:{port}"
    assert status_of(port, origin=own) == 101
    assert status_of(port, origin="http://evil.example") == 403
    assert status_of(port, origin="null") == 403
    assert status_of(port, origin="http://127.0.0.1:1") == 403
    rebound = f"evil.example:{port}"
    assert status_of(port, host=rebound, origin=f"http://{rebound}") == 421
    assert status_of(port, path="/elsewhere", origin=own) == 404


def test_garbage_and_idle_connections_are_survived(rig, port):
    lots = random.Random(5)
    for n in range(40):
        garbage = lots.randbytes(lots.randrange(1, 3000))
        if n % 4 == 0:
            garbage = b"GET /live HTTP/1.1\r\n" + garbage + b"\r\n\r\n"
        try:
            with socket.create_connection(("127.0.0.1", port), 5) as s:
                s.sendall(garbage)
        except ConnectionError:
            pass
    long = b"GET / HTTP/1.1\r\n" + b"X: " + b"a" * 20_000
    assert not http(port, long + b"\r\n\r\n").startswith(b"HTTP/1.1 200")
    # Nobody says anything: they are let go, and what comes after them waits at most so long.
    idle = [socket.create_connection(("127.0.0.1", port), 5) for _ in range(60)]
    deadline = time.monotonic() + 30
    while True:
        try:
            if get(port)[0] == 200:
                break
        except (OSError, IndexError):
            pass
        assert time.monotonic() < deadline, "idle connections keep all others out"
        time.sleep(0.3)
    for s in idle:
        s.close()
    assert rig.simulator.process.poll() is None


def ended(page, seconds=10):
    deadline = time.monotonic() + seconds
    try:
        while time.monotonic() < deadline:
            page.receive()
    except (EOFError, ConnectionError):
        return True
    return False


def test_messages_that_cannot_be_end_a_connection(rig, port):
    for spoil in (lambda page: page.send("x" * 100_000),
                  lambda page: page.send(b"\x00" * 10),
                  lambda page: page.send("long but no ping" * 20),
                  lambda page: page.socket.sendall(b"\x81\x05hello"),
                  lambda page: page.socket.sendall(os.urandom(4000)),
                  lambda page: [page.send("p1") for _ in range(500)]):
        page = WebSocket(port)
        try:
            spoil(page)
        except ConnectionError:
            pass
        assert ended(page), spoil
        page.close()


def test_places_are_bounded_and_free_again(rig, port):
    pages, statuses = [], []
    for _ in range(12):
        try:
            pages.append(WebSocket(port))
            statuses.append(101)
        except Refused as refused:
            statuses.append(refused.status)
    assert statuses.count(101) == 8 and set(statuses[8:]) == {503}, statuses
    for page in pages:
        page.close()
    deadline = time.monotonic() + 10
    while status_of(port) != 101:
        assert time.monotonic() < deadline


def test_a_client_that_takes_nothing_is_cut_off_and_hurts_nobody(rig, port):
    stuck = WebSocket(port)
    stuck.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
    with WebSocket(port) as page:
        for _ in range(25):
            page.wait(lambda m: m["k"] == "f")
    stuck.close()


def test_others_need_a_token(tmp_path):
    port = free_port(socket.SOCK_STREAM)
    where = f'[watch]\naddress = "tcpin:0.0.0.0:{port}"\n'
    (tmp_path / "open").mkdir()
    with pytest.raises(RuntimeError, match="watch.token_file"):
        Rig(tmp_path / "open", lockstep=True, more=where)
    token = tmp_path / "token"
    token.write_text("0123456789abcdefXYZ\n")
    token.chmod(0o600)
    (tmp_path / "shut").mkdir()
    with Rig(tmp_path / "shut", lockstep=True, speed=1,
             more=where + f'token_file = "{token}"\n'):
        assert get(port)[0] == 200  # the page itself holds nothing
        for wrong in ("/live", "/live?token=", "/live?token=0123456789abcdefXYz"):
            assert status_of(port, wrong) == 401, wrong
        name = f"bench.local:{port}"
        right = "/live?token=0123456789abcdefXYZ"
        assert status_of(port, right, host=name, origin=f"http://{name}") == 101
        assert status_of(port, right, host=name, origin="http://evil.example") == 403
        with WebSocket(port, right) as page:
            page.wait(lambda m: m["k"] == "f" and "p" in m, 30)


def test_the_real_companion_serves_it_from_a_thread_of_its_own(tmp_path):
    port = free_port(socket.SOCK_STREAM)
    with Rig(tmp_path, more=f'[watch]\naddress = "tcpin:127.0.0.1:{port}"\n') as real:
        deadline = time.monotonic() + 20
        while "watch the flight at" not in real.said():
            assert time.monotonic() < deadline, real.said()
            time.sleep(0.1)
        with WebSocket(port) as page:
            page.wait(lambda m: m["k"] == "f" and "p" in m, 30)
            slow = page.wait(lambda m: m["k"] == "s" and m["late"]["of"] > 50, 20)
            assert slow["health"]["steps"] > 0 and slow["lost"] == 0, slow
