"""The package `haltere_gap` against the program, and its worked example."""

import os
import pathlib
import runpy
import sys

import pytest

from haltere_gap import GapError, diagnose

PYTHON = pathlib.Path(__file__).resolve().parents[2] / "python"
#: The simulator's program is the companion as well.
PROGRAM = [os.environ["HALTERE_TEST_SIM"], "companion"]


@pytest.fixture(scope="module")
def example():
    """What the example leaves behind."""
    argv = sys.argv
    sys.argv = ["example.py", *PROGRAM]
    try:
        return runpy.run_path(str(PYTHON / "example.py"))
    finally:
        sys.argv = argv


def test_the_example_names_the_motor_that_was_weakened(example):
    found = example["found"]
    assert found.outcome == "named"
    assert [cause.id for cause in found.causes] == ["weak_motor M3"]
    low, high = found.causes[0].sizes_90[0]
    assert low < 0.22 < high
    assert found.held_out.shrink > 0.8
    assert found.can_show["weak_motor"] < 0.22 and found.not_checked


def test_the_example_calls_a_healthy_flight_no_gap(example):
    fine = example["fine"]
    assert fine.outcome == "no_gap" and fine.causes == [] and fine.nothing > 0.6


def test_tables_hold_what_the_lists_hold(example):
    found = example["found"]
    table = found.balance_table()
    assert list(table.index) == ["vertical force", "roll", "pitch", "yaw"]
    assert table.loc["roll", "share"] == found.balance[1].share
    assert found.candidates_table().index[0] == "weak_motor M3"


def test_a_page_is_written(example, tmp_path):
    page = tmp_path / "weak.html"
    diagnose(example["weak"], example["healthy"], "crazyflie-2.1", report=page, program=PROGRAM)
    assert "weak motor" in page.read_text() and page.with_suffix(".json").exists()


def test_what_cannot_be_judged_is_told(example):
    healthy = example["healthy"]
    short = {name: values[:600] for name, values in healthy[0].items()}
    found = diagnose([short], healthy, "crazyflie-2.1", program=PROGRAM)
    assert found.outcome == "not_testable" and "hovers" in found.verdict and found.balance == []
    with pytest.raises(GapError, match="accepted flights"):
        diagnose([healthy[0]], healthy[1:2], "crazyflie-2.1", program=PROGRAM)
    with pytest.raises(ValueError, match="m4"):
        diagnose([{name: healthy[0][name] for name in ("t_s", "m1", "m2", "m3")}], healthy, "crazyflie-2.1")
    with pytest.raises(ValueError, match="kind"):
        diagnose(["log00"], ["log01"], "crazyflie-2.1", program=PROGRAM)


#: A simulator in which a weak motor is told more, and a load does nothing.
TINY = """
import json, sys
for line in sys.stdin:
    asked = json.loads(line)
    told = [0.45 / factor for factor in asked["jitter"]["thrust"]]
    for effect in asked["effects"]:
        if effect["id"] == "weak_motor":
            told[effect["motor"] - 1] /= 1 - effect["size"]
    rows = [[k / 100, *told, asked["height_m"]] for k in range(1000)]
    columns = ["t_s", "m1", "m2", "m3", "m4", "height_m"]
    print("a line that is no answer")
    print(json.dumps({"flight": asked["flight"], "columns": columns, "rows": rows}), flush=True)
"""


def test_a_tiny_program_flies_what_causes_do(example, tmp_path):
    tiny = tmp_path / "tiny.py"
    tiny.write_text(TINY)
    told = {"references": example["healthy"], "vehicle": "crazyflie-2.1", "program": PROGRAM}
    found = diagnose(example["weak"], simulator=f"{sys.executable} {tiny}", **told)
    assert found.raw["simulator"]["flights"] == 27 and found.raw["simulator"]["lost"] == {}
    assert [cause.id for cause in found.causes] == ["weak_motor M3"]
    with pytest.raises(GapError, match="no healthy flight of the simulator can be used"):
        diagnose(example["weak"], simulator=f"{sys.executable} -c pass", **told)
