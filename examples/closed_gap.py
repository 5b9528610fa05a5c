"""A simulated vehicle whose wings give 12 % less thrust than its file says: found, named, put into the simulator, and mended. Takes
minutes of two cores, and a folder as its argument. docs/TUTORIAL_GAP.md explains each step.

    python closed_gap.py gap
"""

import pathlib
import subprocess
import sys

from haltere_testing import program

#: What `haltere gap diagnose` exits with when it names an effect.
NAMED = 10


def run(folder, *command, code=0):
    print(">", *command, flush=True)
    ended = subprocess.run([program(), *command], cwd=folder).returncode
    if ended != code:
        sys.exit(f"exit code {ended}, {code} is due")


def main(folder):
    folder.mkdir(parents=True, exist_ok=True)
    run(folder, "fly", "diagnostic", "held-out", "--count", "8", "--out", "good")
    run(folder, "fly", "diagnostic", "held-out", "--count", "3", "--seed", "101", "--effect", "P1.loss=0.12", "--out", "bad")
    held_out = [f"bad/held-out-{seed}.mcap" for seed in (101, 102, 103)]
    run(folder, "companion", "gap", "diagnose", "bad/diagnostic-101.mcap", *held_out, "--reference", "good", "--size", "small",
        "--without-advice", "--report", "gap.html", code=NAMED)
    run(folder, "companion", "gap", "accept", "gap.json", "--scenario", "sim.toml")
    run(folder, "fly", "diagnostic", "--seed", "201", "--out", "mended")
    run(folder, "companion", "gap", "diagnose", "mended/diagnostic-201.mcap", "--reference", "good", "--size", "small",
        "--without-advice")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "gap"))
