"""Fixtures for pytest. `haltere` is a vehicle ready to fly, with the simulator and the companion behind it.

    def test_it_hovers(haltere):
        station = haltere.station()
        station.takeoff(1.2)
        assert abs(haltere.height() - 1.2) < 0.2
        station.land()

It runs in lockstep, faster than real time. `@pytest.mark.haltere(lockstep=False)` takes the real companion on
real wires; its other arguments are those of `Rig`. With `mavsdk`, `mavproxy` and `dronekit`, clients that have a clock of their own,
simulated time runs at twice the speed of real time unless the mark says otherwise. With `pytest --haltere-real CONFIG`
the same test flies a real vehicle.
"""

from __future__ import annotations

import pathlib
from typing import Any, Callable, Iterator

import pytest

from .clients import MavProxy, dronekit_vehicle, mavsdk_system
from .programs import NOT_JUDGED
from .rig import Rig
from .vehicle import Vehicle, or_none

#: Fixtures whose client has a clock of its own, and how many times as fast as real time passes then.
CLOCKED, SPEED = ("dronekit", "mavproxy", "mavsdk"), 2

_report = pytest.StashKey[Any]()
#: The vehicle of a test, from its start on.
_vehicle = pytest.StashKey[Vehicle]()
#: Tests that failed while their simulator was not given the time.
_late = pytest.StashKey[list[str]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("haltere").addoption(
        "--haltere-real", metavar="CONFIG", type=pathlib.Path,
        help="fly the real vehicle of this configuration file; asks before each take-off")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_late] = []
    config.addinivalue_line("markers", "haltere(**options): how the fixture `haltere` is started")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo) -> Iterator[Any]:
    outcome: Any = yield
    report = outcome.get_result()
    if not report.failed or report.when == "teardown":
        return
    vehicles = [item.stash.get(_vehicle, None), *getattr(item, "funcargs", {}).values()]
    vehicle = next((each for each in vehicles if isinstance(each, Vehicle)), None)
    if vehicle is None:
        return
    late = or_none(vehicle.not_judged)
    if late:
        item.config.stash[_late].append(f"{item.nodeid}: {late}")
    if report.when == "call" and _vehicle in item.stash:
        # At once, as it stands when the test fails.
        report.sections.append(("haltere", "\n".join(vehicle.facts())))
        item.stash[_report] = report


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    for words in config.stash[_late]:
        terminalreporter.write_line(words)


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    # What failed beside them is a failure.
    if session.testsfailed and session.testsfailed == len(session.config.stash[_late]):
        session.exitstatus = NOT_JUDGED


@pytest.fixture
def haltere(request: pytest.FixtureRequest, tmp_path: pathlib.Path) -> Iterator[Vehicle]:
    """A vehicle that is ready to fly."""
    config = request.config.getoption("--haltere-real")
    if config is not None:
        yield from _real(request, config, tmp_path)
        return
    marker = request.node.get_closest_marker("haltere")
    options = {"lockstep": True, **(marker.kwargs if marker else {})}
    if options["lockstep"] and any(name in request.fixturenames for name in CLOCKED):
        options.setdefault("speed", SPEED)
    rig = request.node.stash[_vehicle] = Rig(tmp_path, **options)
    try:
        rig.settle()
        lookout = rig.look_out()
        yield rig
        if _report not in request.node.stash:
            lookout.check()
            lookout.assert_all_came()
    finally:
        _close(request, rig)


def _real(request: pytest.FixtureRequest, config: pathlib.Path, folder: pathlib.Path) -> Iterator[Vehicle]:
    from .real import RealVehicle
    vehicle = request.node.stash[_vehicle] = RealVehicle(config, folder, request.node.nodeid)
    try:
        vehicle.settle()
        with vehicle.kept():
            yield vehicle
    finally:
        _close(request, vehicle)


def _close(request: pytest.FixtureRequest, vehicle: Vehicle) -> None:
    """Ends it; a test that failed gets the page of its flight, for which the log must be whole."""
    try:
        vehicle.close()
    finally:
        report = request.node.stash.get(_report, None)
        if report is not None:
            report.sections.append(("haltere", f"report: {vehicle.page() or 'could not be drawn'}"))


@pytest.fixture
def mavsdk(haltere: Vehicle) -> Iterator[Any]:
    """MAVSDK 4's system, for its plugins: `Action(mavsdk)`."""
    own, system = _client("mavsdk", lambda: mavsdk_system(haltere.address(client="mavsdk")))
    yield system
    own.destroy()


@pytest.fixture
def mavproxy(haltere: Vehicle, tmp_path: pathlib.Path) -> Iterator[MavProxy]:
    """MAVProxy, connected: `mavproxy.do("arm throttle", "ACCEPTED")`."""
    proxy = _client("MAVProxy", lambda: MavProxy(haltere.address(client="mavproxy"), tmp_path, vehicle=haltere.system_id))
    yield proxy
    proxy.close()


@pytest.fixture
def dronekit(haltere: Vehicle) -> Iterator[Any]:
    """DroneKit's vehicle, with the names of haltere's modes: `dronekit.simple_takeoff(1.2)`."""
    vehicle = _client("dronekit", lambda: dronekit_vehicle(haltere.address(client="dronekit")))
    yield vehicle
    vehicle.close()


def _client(name: str, connect: Callable[[], Any]) -> Any:
    """A client that is connected; skipped where it is not installed."""
    try:
        return connect()
    except ImportError as error:
        pytest.skip(f"{name} is not installed: {error}")
