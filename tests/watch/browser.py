"""Headless Chromium by its own protocol: opens a page, looks into it, takes pictures."""

import base64
import json
import pathlib
import shutil
import subprocess
import time

from sockets import WebSocket

NAMES = ("chromium", "chromium-browser", "google-chrome")


def program():
    return next((path for path in map(shutil.which, NAMES) if path), None)


class Browser:
    def __init__(self, folder):
        profile = pathlib.Path(folder) / "chromium"
        profile.mkdir()
        self.process = subprocess.Popen(
            [program(), "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
             "--no-first-run", "--disable-background-networking", "--disable-component-update",
             "--disable-sync", "--disable-dev-shm-usage", f"--user-data-dir={profile}",
             "--remote-debugging-port=0", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=open(pathlib.Path(folder) / "chromium.txt", "w"))
        where = profile / "DevToolsActivePort"
        deadline = time.monotonic() + 60
        while not (where.exists() and len(where.read_text().split()) == 2):
            assert time.monotonic() < deadline, "chromium does not start"
            assert self.process.poll() is None, "chromium ended"
            time.sleep(0.1)
        port, path = where.read_text().split()
        self.socket = WebSocket(int(port), path, seconds=60.0)
        self.number = 0
        self.console = []

    def call(self, method, session=None, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        self.socket.send(json.dumps(message))
        while True:
            answer = json.loads(self.socket.receive())
            if answer.get("method") in ("Runtime.exceptionThrown", "Log.entryAdded",
                                        "Runtime.consoleAPICalled"):
                self.console.append(answer["params"])
            if answer.get("id") == self.number:
                assert "error" not in answer, answer
                return answer["result"]

    def open(self, address, width, height, scale=1, mobile=False, dark=False):
        return Page(self, address, width, height, scale, mobile, dark)

    def close(self):
        self.socket.close()
        self.process.terminate()
        self.process.wait(20)


class Page:
    def __init__(self, browser, address, width, height, scale, mobile, dark):
        self.browser = browser
        target = browser.call("Target.createTarget", url="about:blank")["targetId"]
        self.target = target
        self.session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=scale, mobile=mobile)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.call("Page.navigate", url=address)

    def call(self, method, **params):
        return self.browser.call(method, session=self.session, **params)

    def value(self, expression):
        result = self.call("Runtime.evaluate", expression=expression, returnByValue=True,
                           awaitPromise=True)
        assert "exceptionDetails" not in result, result
        return result["result"].get("value")

    def wait(self, expression, seconds=20.0):
        deadline = time.monotonic() + seconds
        while not self.value(expression):
            if time.monotonic() > deadline:
                raise AssertionError(f"{expression}: not within {seconds} s; console "
                                     f"{self.browser.console[-5:]}; {self.value('document.body.innerText')}")
            time.sleep(0.1)

    def picture(self, path, whole=False):
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        pathlib.Path(path).write_bytes(base64.b64decode(shot["data"]))

    def close(self):
        self.browser.call("Target.closeTarget", targetId=self.target)
