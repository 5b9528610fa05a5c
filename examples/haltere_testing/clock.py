"""Two kinds of time that a script can live in: that of the wall, and that of a simulator in lockstep."""

import time


class RealTime:
    """Time passes by itself, also while the computer does something else."""

    lockstep = False
    # How many times as long as the vehicle may take is waited for what must come: only a failure lasts
    # longer by it. How fast the vehicle answers is measured on simulated time.
    PATIENCE = 3

    def patience(self, seconds):
        return self.PATIENCE * seconds

    def now(self):
        return time.monotonic()

    def sleep(self, seconds):
        time.sleep(seconds)

    def receive(self, link, timeout):
        return link.recv_match(blocking=True, timeout=timeout)


class Simulated:
    """Time passes only while somebody waits for something: as fast as the computer can, and the same each
    time. `run` lets a simulator's time pass and gives what it is then."""

    lockstep = True
    # Between two looks at what came, s. A datagram that was sent waits in the socket until then.
    STEP_S = 0.02

    def __init__(self, run):
        self.run, self.t_s = run, 0.0

    def patience(self, seconds):
        return seconds

    def now(self):
        return self.t_s

    def sleep(self, seconds):
        end = self.t_s + seconds
        while end - self.t_s > 1e-6:
            self.t_s = self.run(min(self.STEP_S, end - self.t_s))

    def receive(self, link, timeout):
        end = self.t_s + timeout
        while True:
            message = link.recv_match(blocking=False)
            if message is not None or self.t_s >= end:
                return message
            self.t_s = self.run(self.STEP_S)
