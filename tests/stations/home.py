"""A home folder with the shipped map of modes, as the manual says: before pymavlink is imported."""

import os
import pathlib
import shutil
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
HOME = pathlib.Path(tempfile.mkdtemp(prefix="haltere-home-"))
(HOME / ".pymavlink").mkdir()
shutil.copy(ROOT / "stations/custom_mode_map.json", HOME / ".pymavlink")
os.environ["HOME"] = str(HOME)
