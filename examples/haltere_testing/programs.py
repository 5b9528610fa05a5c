"""haltere's programs: where they are, and one of the simulator as a process that takes orders."""

from __future__ import annotations

import importlib.metadata
import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import threading
from typing import Any, Optional, Sequence, Union


def installed() -> Optional[str]:
    """The simulator program that came with this package, where it was a wheel that holds it."""
    try:
        files = importlib.metadata.files("haltere-testing") or ()
    except importlib.metadata.PackageNotFoundError:
        return None
    places = (pathlib.Path(str(f.locate())).resolve() for f in files if f.name == "haltere-sim")
    return next((str(place) for place in places if place.exists()), None)


def program() -> str:
    """The simulator program, which is also the companion: HALTERE_SIM, else the one of the wheel, else the one
    on the path, else one built in this repository."""
    named = os.environ.get("HALTERE_TEST_SIM") or os.environ.get("HALTERE_SIM")
    found = named or installed() or shutil.which("haltere-sim")
    root = pathlib.Path(__file__).resolve().parents[2]
    for profile in ("release", "debug"):
        built = root / "target" / profile / "haltere-sim"
        if found is None and built.exists():
            found = str(built)
    if found is None or not os.path.exists(found):
        raise FileNotFoundError(
            f"haltere-sim is not {'at ' + found if found else 'in this package nor on the path'}: install the "
            "wheel that holds it (packaging/build-wheel), set HALTERE_SIM to the program, or build it with "
            "`cargo build --release --workspace`")
    return found


def free_port(kind: int = socket.SOCK_DGRAM) -> int:
    """A port of this computer that nobody has."""
    with socket.socket(socket.AF_INET, kind) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


#: Exit code of a simulator that was not given the time, and of a run of pytest in which nothing else failed.
NOT_JUDGED = 75


class Simulator:
    """A process of haltere-sim that takes orders: `serve` (tag and board in real time) or `lockstep`
    (companion included, on simulated time). `said` is the file that holds what it says."""

    def __init__(self, arguments: Sequence[str], said: Union[str, os.PathLike]):
        self.said = pathlib.Path(said)
        self.lock = threading.Lock()
        self.process = subprocess.Popen(
            [program(), *arguments, "--orders"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=open(self.said, "w"), text=True)
        assert self.process.stdin and self.process.stdout  # both are pipes
        self._orders, self._answers = self.process.stdin, self.process.stdout
        line = self._answers.readline()
        if not line:
            raise RuntimeError(f"haltere-sim did not start: {self.said.read_text()}")
        self.greeting = json.loads(line)

    def order(self, **order: Any) -> dict[str, Any]:
        """Gives an order, and its answer."""
        with self.lock:
            try:
                self._orders.write(json.dumps(order) + "\n")
                self._orders.flush()
                line = self._answers.readline()
            except (BrokenPipeError, ValueError):
                line = ""
        if not line:
            raise RuntimeError(f"haltere-sim is gone: {self.said.read_text()[-2000:]}")
        answer = json.loads(line)
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer

    def run(self, seconds: float) -> float:
        """Lets simulated time pass; gives what it is then, s."""
        return self.order(run_s=seconds)["t_s"]

    def truth(self) -> dict[str, float]:
        """What really is, by the names of the columns of a truth file."""
        return self.order(truth=True)["truth"]


def stop(processes: Sequence[subprocess.Popen], seconds: float = 40) -> list[Union[int, str]]:
    """Ends processes by a signal; gives their exit codes."""
    codes: list[Union[int, str]] = []
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
    for process in processes:
        try:
            codes.append(process.wait(timeout=seconds))
        except subprocess.TimeoutExpired:
            process.kill()
            codes.append("killed")
    return codes
