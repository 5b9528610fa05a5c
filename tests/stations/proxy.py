"""MAVProxy in a pseudo-terminal."""

import os
import re
import sys
import time

import home
import pexpect


class Proxy:
    def __init__(self, port, folder, modules="arm,mode,misc,cmdlong,wp,param,link,rc,battery,ftp"):
        script = os.path.join(os.path.dirname(sys.executable), "mavproxy.py")
        environment = dict(os.environ, HOME=str(home.HOME), TERM="dumb", MPLBACKEND="agg",
                           PYTHONWARNINGS="ignore")
        environment.pop("PYTHONPATH", None)
        self.log = open(folder / "mavproxy.txt", "w")
        self.child = pexpect.spawn(
            sys.executable, [script, f"--master=udpout:127.0.0.1:{port}", "--mav20",
                             f"--default-modules={modules}", "--state-basedir", str(folder)],
            env=environment, cwd=str(folder), encoding="utf-8", codec_errors="replace",
            timeout=20, logfile=self.log)
        self.expect(r"Detected vehicle 1:1|online system 1", 40)
        self.mode = "?"

    def expect(self, pattern, timeout=20):
        try:
            return self.child.expect(pattern, timeout=timeout)
        except (pexpect.TIMEOUT, pexpect.EOF) as error:
            self.log.flush()
            raise AssertionError(
                f"{pattern!r} was not said; it said {self.child.before[-1500:]!r}") from error

    def do(self, line, pattern=None, timeout=20):
        self.child.sendline(line)
        if pattern:
            self.expect(pattern, timeout)

    def until(self, line, pattern, tries=20):
        """The same again, as a person does who is told to wait."""
        for _ in range(tries):
            self.child.sendline(line)
            if self.child.expect([pattern, pexpect.TIMEOUT], timeout=2) == 0:
                return
        raise AssertionError(f"{pattern!r} not after {line!r}: {self.child.before[-1500:]!r}")

    def quiet(self, seconds=1.0):
        time.sleep(seconds)
        try:
            text = self.child.read_nonblocking(100_000, 0)
        except pexpect.TIMEOUT:
            text = ""
        return re.sub(r"\x1b\[[0-9;]*[A-Za-z]", "", text)

    def close(self):
        self.child.sendline("exit")
        try:
            self.child.expect(pexpect.EOF, timeout=5)
        except pexpect.TIMEOUT:
            pass
        self.child.close(force=True)
        self.log.close()
