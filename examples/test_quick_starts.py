"""The beginnings of the project's README: a first square flight, and missions to test. The third, a gap between simulator and
flight that is found and closed, is `closed_gap.py`: it takes minutes."""

import pathlib
import subprocess

from haltere_testing import program

MISSION = pathlib.Path(__file__).with_name("square.toml")
SQUARE = [(4.0, 4.0, 1.2), (4.0, 6.0, 1.2), (6.0, 6.0, 1.2), (6.0, 4.0, 1.2), (4.0, 4.0, 1.2)]


def run(folder, *command):
    """A command of haltere's; `companion` makes the simulator program the companion."""
    ran = subprocess.run([program(), *map(str, command)], cwd=folder, text=True, capture_output=True)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout


def test_a_first_square_flight(tmp_path):
    """As fast as the computer is, without a script; its log as a page."""
    assert "landed" in run(tmp_path, "fly", MISSION, "--out", tmp_path)
    log, truth = tmp_path / "square-1.mcap", tmp_path / "square-1.truth.csv"
    run(tmp_path, "companion", "report", log, "--truth", truth, "--output", "square.html")
    assert "<svg" in (tmp_path / "square.html").read_text()
    assert "reproduced bit for bit" in run(tmp_path, "companion", "replay", log)


def test_a_mission_of_a_file(haltere):
    """The same file, uploaded by a station, and held against its corners."""
    station = haltere.station()
    station.upload(MISSION)
    station.fly_mission()
    haltere.assert_track(SQUARE, within=0.5)
    haltere.assert_landed()
