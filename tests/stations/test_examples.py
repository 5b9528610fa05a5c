"""The missions in examples/, as they stand, each against a vehicle at three times real time."""

import csv
import math
import pathlib
import subprocess
import sys

import pytest

from haltere_testing.rig import Rig

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "examples"
CORNERS = [(4.0, 4.0), (4.0, 6.0), (6.0, 6.0), (6.0, 4.0)]
SPEED = 3


@pytest.mark.parametrize("script, port, scheme", [
    ("pymavlink_square.py", "generic", "udpout:"),
    ("mavsdk_square.py", "gps", "udpout://"),
    ("mavproxy_square.py", "generic", "udpout:"),
])
def test_the_square_is_flown(tmp_path, script, port, scheme):
    rig = Rig(tmp_path, lockstep=True, speed=SPEED)
    rig.settle()
    address = f"{scheme}127.0.0.1:{rig.ports[port]}"
    flown = subprocess.run([sys.executable, str(EXAMPLES / script), address], cwd=tmp_path,
                           text=True, capture_output=True, timeout=180)
    said = flown.stdout + flown.stderr[-2000:]
    assert flown.returncode == 0 and flown.stdout.rstrip().endswith("landed"), said
    rig.assert_landed()
    rig.close()
    with open(rig.folder / "truth.csv") as f:
        places = [(float(r["pos_E_x_m"]), float(r["pos_E_y_m"]), -float(r["pos_E_z_m"]))
                  for r in csv.DictReader(f)]
    for north, east in CORNERS:
        closest = min(math.dist(at, (north, east, 1.2)) for at in places)
        assert closest < 0.6, f"{closest} m from {north, east}"
    rig.assert_replayed()
