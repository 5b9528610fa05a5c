"""A square of 2 m with MAVProxy: types its commands and reads what it says, as a person would. Connects where
its argument says:

    haltere-sim lockstep --speed 2 &          # a vehicle; or a real companion
    python mavproxy_square.py udpin:127.0.0.1:14550

By hand: `mavproxy.py --master=udpin:127.0.0.1:14550 --mav20`, then the lines that this prints after `>`.
"""

import os
import pathlib
import shutil
import sys
import tempfile

import pexpect  # as MAVProxy itself, from the package index

# The mission in local metres needs the older form of items: docs/STATIONS.md says why.
MISSION = """QGC WPL 110
0\t1\t1\t22\t0\t0\t0\t0\t5.0\t5.0\t-1.2\t1
1\t0\t1\t16\t1\t0.4\t0\t0\t4.0\t4.0\t-1.2\t1
2\t0\t1\t16\t1\t0.4\t0\t0\t4.0\t6.0\t-1.2\t1
3\t0\t1\t16\t1\t0.4\t0\t0\t6.0\t6.0\t-1.2\t1
4\t0\t1\t16\t1\t0.4\t0\t0\t6.0\t4.0\t-1.2\t1
5\t0\t1\t16\t1\t0.4\t0\t0\t4.0\t4.0\t-1.2\t1
6\t0\t1\t21\t0\t0\t0\t0\t4.0\t4.0\t0\t1
"""


class Prompt:
    def __init__(self, address, folder):
        beside = os.path.join(os.path.dirname(sys.executable), "mavproxy.py")
        script = beside if os.path.exists(beside) else shutil.which("mavproxy.py")
        if script is None:
            sys.exit("mavproxy.py is not installed: pip install MAVProxy future")
        environment = dict(os.environ, TERM="dumb", PYTHONWARNINGS="ignore")
        environment.pop("PYTHONPATH", None)
        self.child = pexpect.spawn(
            sys.executable, [script, f"--master={address}", "--mav20",
                             "--default-modules=arm,mode,misc,cmdlong,wp", "--state-basedir", folder],
            cwd=folder, env=environment, encoding="utf-8", codec_errors="replace")
        self.until(r"Detected vehicle 1:1|online system 1", 40)

    def until(self, pattern, seconds=20):
        try:
            self.child.expect(pattern, timeout=seconds)
        except (pexpect.TIMEOUT, pexpect.EOF):
            sys.exit(f"{pattern!r} was not said within {seconds} s; it said {self.child.before[-1500:]}")
        return self.child.after

    def type(self, line, pattern=None, seconds=20):
        print(">", line)
        self.child.sendline(line)
        if pattern:
            print(" ", self.until(pattern, seconds))

    def again(self, line, pattern, tries=20):
        """The same again, as a person does who is told to wait."""
        print(">", line)
        for _ in range(tries):
            self.child.sendline(line)
            if self.child.expect([pattern, pexpect.TIMEOUT], timeout=2) == 0:
                return print(" ", self.child.after)
        sys.exit(f"{pattern!r} was not said; it said {self.child.before[-1500:]}")


def main(address):
    with tempfile.TemporaryDirectory() as folder:
        pathlib.Path(folder, "square.txt").write_text(MISSION)
        prompt = Prompt(address, folder)
        prompt.type("set wp_use_mission_int False")
        prompt.type("wp load square.txt", r"Loaded \d+ waypoints")
        prompt.until(r"MISSION_ACK|Sent all \d+ waypoints", 20)
        prompt.again("arm throttle", r"ARM_DISARM: ACCEPTED")
        prompt.type("long MISSION_START 0 0", r"MISSION_START: ACCEPTED")
        for corner in range(1, 6):
            prompt.until(rf"waypoint {corner}\b|reached.* {corner}\b|Reached #{corner}", 60)
            print("  reached corner", corner)
        prompt.until(r"DISARMED", 90)
        print("landed")
        prompt.child.sendline("exit")
        prompt.child.expect([pexpect.EOF, pexpect.TIMEOUT], timeout=5)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "udpin:127.0.0.1:14550")
