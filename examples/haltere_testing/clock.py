"""Two kinds of time that a script can live in: that of the wall, and that of a simulator in lockstep."""

from __future__ import annotations

import time
from typing import Any, Callable


class RealTime:
    """Time passes by itself, also while the computer does something else."""

    lockstep = False
    # How many times as long as the vehicle may take is waited for what must come: only a failure lasts
    # longer by it. How fast the vehicle answers is measured on simulated time.
    PATIENCE = 3

    def patience(self, seconds: float) -> float:
        """How long to wait for what the vehicle may take so many seconds for."""
        return self.PATIENCE * seconds

    def now(self) -> float:
        """Seconds, from any beginning."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Lets time pass."""
        time.sleep(seconds)

    def receive(self, link: Any, timeout: float) -> Any:
        """The next message of a pymavlink connection; None where none came."""
        return link.recv_match(blocking=True, timeout=timeout)


class Simulated:
    """Time passes only while somebody waits for something: as fast as the computer can, and the same each
    time. `run` lets a simulator's time pass and gives what it is then."""

    lockstep = True
    # Between two looks at what came, s. A datagram that was sent waits in the socket until then.
    STEP_S = 0.02

    def __init__(self, run: Callable[[float], float]):
        self.run, self.t_s = run, 0.0
        #: Called after each step.
        self.lookers: list[Callable[[], None]] = []

    def patience(self, seconds: float) -> float:
        """As long as the vehicle may take."""
        return seconds

    def now(self) -> float:
        """Simulated seconds since the start."""
        return self.t_s

    def sleep(self, seconds: float) -> None:
        """Lets simulated time pass."""
        end = self.t_s + seconds
        while end - self.t_s > 1e-6:
            self.step(min(self.STEP_S, end - self.t_s))

    def receive(self, link: Any, timeout: float) -> Any:
        """The next message of a pymavlink connection; simulated time passes until one comes."""
        end = self.t_s + timeout
        while True:
            message = link.recv_match(blocking=False)
            if message is not None or self.t_s >= end:
                return message
            self.step(self.STEP_S)

    def step(self, seconds: float) -> None:
        """One step, and a look at what became of it."""
        self.t_s = self.run(seconds)
        for look in self.lookers:
            look()
