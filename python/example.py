"""A weak motor, from flights that are made here: four that were in order, and two with the propeller of motor 3 cut.

Run it with `haltere` on the path, or with the command in its place: python example.py /path/to/haltere
"""

# %% Flights. Yours are files, or tables with the same columns.
import math
import random
import sys

from haltere_gap import diagnose


def flight(seed, shares, trembling=0.02):
    """20 s at 100 Hz, 12 of them in hover; `shares`: what each motor is told, of a hovering command."""
    chance = random.Random(seed)
    session = [1 + chance.gauss(0, 0.003) for _ in shares]
    table = {name: [] for name in ("t_s", "m1", "m2", "m3", "m4", "height_m")}
    for k in range(2000):
        is_up = 400 <= k < 1600
        table["t_s"].append(k / 100)
        table["height_m"].append(0.5 if is_up else 0.0)
        shake = trembling * math.sin(2.0 * k)
        for motor, (share, of) in enumerate(zip(shares, session)):
            side = 1 if motor < 2 else -1
            table[f"m{motor + 1}"].append(0.45 * share * of * (1 + side * shake) if is_up else 0.0)
    return table


healthy = [flight(seed, [1.02, 0.95, 1.12, 0.90]) for seed in range(4)]
# A cut propeller gives less thrust for the same command, and shakes.
weak = [flight(seed, [1.02, 0.95, 1.12 / 0.78, 0.90], trembling=0.06) for seed in (10, 11)]

# %% What has changed?
program = sys.argv[1:] or None
found = diagnose(weak, references=healthy, vehicle="crazyflie-2.1", program=program)
print(found.verdict)
print("these references can show:", found.can_show)
print("closed on the flight that was not used:", round(found.held_out.shrink, 2))

# %% As tables, where pandas is installed.
try:
    print(found.balance_table()[["share", "sigma", "left"]])
except ImportError as why:
    print(why)

# %% A flight that was in order.
fine = diagnose([flight(20, [1.02, 0.95, 1.12, 0.90])], references=healthy, vehicle="crazyflie-2.1", program=program)
print(fine.verdict)
