"""Looks at the vehicle while time passes: keeps its track, and does what is to be done at a moment of the flight."""

from __future__ import annotations

import math
import threading
from typing import Any, Callable, NamedTuple, Optional, Sequence

Point = Sequence[float]


class Here(NamedTuple):
    """Where a vehicle is: seconds of its time, metres of the room, height over the floor."""

    t_s: float
    north_m: float
    east_m: float
    height_m: float
    flies: bool

    @property
    def place(self) -> tuple[float, float, float]:
        """North, east, height, m."""
        return self.north_m, self.east_m, self.height_m


class Moment:
    """A moment of a flight that is awaited, and what happens then. Comes once."""

    def __init__(self, words: str, holds: Callable[[Here], bool], vehicle: Any):
        self.words, self.holds, self.vehicle = words, holds, vehicle
        self.actions: list[Callable[[], Any]] = []
        #: When it came, s; None: not yet.
        self.came_s: Optional[float] = None

    def fault(self, part: str, state: str = "off", **more: Any) -> "Moment":
        """Breaks something then, in the words of a scenario's [[fault]]."""
        return self.do(lambda: self.vehicle.fault(part, state, **more))

    def mend(self, part: str, **more: Any) -> "Moment":
        """Mends it then."""
        return self.fault(part, "healthy", **more)

    def do(self, action: Callable[[], Any]) -> "Moment":
        """Calls something then; it must not wait."""
        self.actions.append(action)
        return self


class Lookout:
    """Track and moments of one vehicle. `here` tells where it is."""

    #: Between two looks where time passes by itself, s.
    PERIOD_S = 0.04

    def __init__(self, here: Callable[[], Optional[Here]]):
        self.here = here
        self.track: list[Here] = []
        self.moments: list[Moment] = []
        self._error: Optional[Exception] = None
        self._ends = threading.Event()
        self._thread: Optional[threading.Thread] = None

    def start(self) -> None:
        """Looks by a thread of its own from now on: for time that passes by itself."""
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        while not self._ends.wait(self.PERIOD_S):
            try:
                self.look()
            except Exception as error:  # told to the test, which runs on another thread
                self._error = error
                return

    def look(self) -> None:
        """One look."""
        here = self.here()
        if here is None:
            return
        self.track.append(here)
        for moment in self.moments:
            if moment.came_s is None and moment.holds(here):
                moment.came_s = here.t_s
                for action in moment.actions:
                    action()

    def check(self) -> None:
        """Raises what went wrong while nobody waited."""
        if self._error is not None and not self._ends.is_set():
            raise self._error

    def close(self) -> None:
        """Looks no more."""
        self._ends.set()
        if self._thread is not None:
            self._thread.join()

    def assert_all_came(self) -> None:
        """Every moment came: what never broke was not tested."""
        missed = [moment.words for moment in self.moments if moment.came_s is None]
        assert not missed, f"never came in this flight: {', '.join(missed)}"


def off_line_m(place: Point, start: Point, end: Point) -> float:
    """Distance of a point from a straight piece, m."""
    along = [b - a for a, b in zip(start, end)]
    length2 = sum(a * a for a in along)
    share = sum((p - a) * d for p, a, d in zip(place, start, along)) / length2 if length2 else 0.0
    share = min(1.0, max(0.0, share))
    return math.dist(place, [a + share * d for a, d in zip(start, along)])


def assert_along(track: Sequence[Here], corners: Sequence[Point], within: float) -> float:
    """The track passes each corner in its order within so many metres, and stays as near to the straight pieces
    between them. Gives the largest distance, m."""
    flown = [here for here in track if here.flies]
    assert flown, "it did not fly"
    corners = [tuple(corner) for corner in corners]
    at, worst = 0, 0.0
    for n, corner in enumerate(corners):
        ahead = range(at, len(flown))
        reached = next((i for i in ahead if math.dist(flown[i].place, corner) <= within), None)
        if reached is None:
            nearest = min((flown[i] for i in ahead), key=lambda here: math.dist(here.place, corner))
            raise AssertionError(
                f"corner {n} {corner} was not reached within {within} m: it was {math.dist(nearest.place, corner):.2f} "
                f"m away at best, {nearest.t_s:.1f} s, at {_words(nearest.place)}")
        if n > 0:
            for here in flown[at:reached]:
                off = off_line_m(here.place, corners[n - 1], corner)
                worst = max(worst, off)
                assert off <= within, (
                    f"{off:.2f} m off the way from corner {n - 1} to {n}, allowed {within} m: at {here.t_s:.1f} s it was "
                    f"at {_words(here.place)}")
        at = reached
    return worst


def _words(place: Point) -> str:
    north, east, height = place
    return f"north {north:.2f}, east {east:.2f}, height {height:.2f} m"
