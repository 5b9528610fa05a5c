"""The page in headless Chromium: on a bench's screen and on a phone."""

import os
import pathlib
import socket

import pytest

from browser import Browser, program
from haltere_testing.rig import Rig, free_port

pytestmark = pytest.mark.skipif(program() is None, reason="no chromium")

# Where pictures are kept for people to look at; else they go with the test.
KEEP = os.environ.get("HALTERE_WATCH_PICTURES")

TEXT = "document.body.innerText"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    browser = Browser(tmp_path_factory.mktemp("browser"))
    yield browser
    browser.close()


def keep(page, tmp_path, name, whole=False):
    path = pathlib.Path(KEEP or tmp_path) / f"{name}.png"
    page.picture(path, whole)
    assert path.stat().st_size > 20_000, path


def colours(page, canvas):
    """How many different colours a canvas shows: an empty one has one."""
    return page.value(f"""(() => {{
        const c = document.getElementById({canvas!r}), d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        const seen = new Set();
        for (let i = 0; i < d.length; i += 4) seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]);
        return seen.size;
    }})()""")


@pytest.mark.parametrize("name, width, height, scale, mobile, dark", [
    ("desktop", 1366, 850, 1, False, False),
    ("phone", 390, 844, 2, True, False),
    ("phone-dark", 390, 844, 2, True, True),
])
def test_the_flight_is_seen(rig, port, station, browser, tmp_path, name, width, height, scale, mobile,
                            dark):
    station.goto(5.6, 5.6 if dark else 4.4, 1.2)
    page = browser.open(f"http://127.0.0.1:{port}/", width, height, scale, mobile, dark)
    page.wait("document.getElementById('mode').textContent === 'goto'"
              " || document.getElementById('mode').textContent === 'hold'")
    page.wait("document.querySelectorAll('#anchors tbody .bar').length === 8")
    page.wait("/\\d+ frames\\/s/.test(document.getElementById('link').textContent)"
              " && parseInt(document.getElementById('link').textContent) >= 10")
    rig.pass_time(1.5)
    text = page.value(TEXT)
    assert "armed" in text and "take-off height reached" in text
    shown = float(page.value("document.querySelector('#pos td').textContent").split()[0])
    assert abs(shown - rig.truth()["pos_E_x_m"]) < 0.5, shown
    for canvas in ("plan", "side"):
        assert colours(page, canvas) > 20, canvas
    # Nothing is cut off to the right.
    assert page.value("document.documentElement.scrollWidth") <= width
    keep(page, tmp_path, name)
    keep(page, tmp_path, name + "-whole", whole=True)
    errors = [c for c in browser.console if c.get("type") == "error" or "exceptionDetails" in c
              or c.get("entry", {}).get("level") == "error"]
    assert not errors, errors
    page.close()


def test_markup_in_words_is_shown_as_words(rig, port, station, browser):
    page = browser.open(f"http://127.0.0.1:{port}/", 1000, 700)
    page.wait("document.querySelectorAll('#events li').length > 3")
    page.value("""event({ t: 1, severity: 4, text: '<img src=x onerror="window.hurt=1"><b>bold</b>' })""")
    assert page.value("document.querySelector('#events li span').textContent").startswith("<img")
    assert page.value("document.querySelectorAll('#events img, #events b').length") == 0
    page.close()


def test_what_is_old_is_said_to_be(rig, port, browser):
    page = browser.open(f"http://127.0.0.1:{port}/", 1000, 700)
    page.wait("/frames/.test(document.getElementById('link').textContent)")
    # As if the companion had vanished.
    page.value("socket.onmessage = null, 0")
    page.wait("!document.getElementById('stale').hidden")
    assert "what is shown is old" in page.value("document.getElementById('stale').textContent")
    assert page.value("document.body.classList.contains('old')")
    page.close()


def test_an_anchor_that_is_left_out_says_so(tmp_path, browser):
    port = free_port(socket.SOCK_STREAM)
    more = (f'[watch]\naddress = "tcpin:127.0.0.1:{port}"\n'
            "[estimator.isolation]\nleave_out = true\nstd_bias_m = 0.1\nleast_m = 0.3\n")
    with Rig(tmp_path, lockstep=True, speed=1, more=more) as rig:
        rig.settle()
        station = rig.station()
        station.takeoff(1.2)
        page = browser.open(f"http://127.0.0.1:{port}/", 1366, 850)
        page.wait("document.querySelectorAll('#anchors tbody .bar').length === 8")
        # Metal between anchor 3 and the whole room.
        rig.fault("effect", effect="U5", values={"bias": 0.8, "std": 0.0, "anchor": 3, "north": 5.0,
                                                 "east": 5.0, "size": 4.0})
        station.said("anchor 3 does not fit the others", 20)
        page.wait("[...document.querySelectorAll('#anchors tbody tr')].map(row => row.innerText)"
                  ".filter(text => text.includes('left out')).map(text => text.trim()[0]).join() === '3'")
        keep(page, tmp_path, "left-out")
        page.close()
        station.land()
