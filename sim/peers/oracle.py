"""What the statistics could tell a diagnosis that has seen the other world.

A forest that learns labelled flights of the generator itself, judged on draws that it has not seen. The
diagnosis has only the nominal simulator to learn from, so this is no peer and no target: where this one fails,
the statistics do not say it; where only the diagnosis fails, the laws of the two worlds differ.

    haltere-sim detectable --draws 8 --labelled labelled.jsonl
    peers/bin/python sim/peers/oracle.py labelled.jsonl
"""

import json
import sys
from collections import Counter

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier

FOLDS = 4
NONE = "none"


def read(path):
    with open(path, encoding="utf-8") as lines:
        next(lines)
        flights = [json.loads(line) for line in lines]
    flights = [f for f in flights if f["landed"] and f["whole"]]
    # X effects are not in the library: nothing could name them.
    return [f for f in flights if not (f["id"] or "").startswith("X")]


def main(path):
    flights = read(path)
    raw = np.array([f["statistics"] for f in flights], dtype=float)
    truth = np.array([f["id"] or NONE for f in flights])
    times = np.array([f["times"] for f in flights])
    draws = np.array([f["draw"] for f in flights])
    healthy = truth == NONE
    use = np.isfinite(raw[healthy]).mean(0) > 0.8
    raw = raw[:, use]
    centre, scale = np.nanmedian(raw[healthy], 0), np.nanstd(raw[healthy], 0)
    moves = scale > 0
    standard = np.nan_to_num((raw[:, moves] - centre[moves]) / scale[moves])
    said = np.empty(len(truth), object)
    for fold in range(FOLDS):
        held = draws % FOLDS == fold
        forest = ExtraTreesClassifier(500, max_features=0.3, n_jobs=-1, random_state=1)
        said[held] = forest.fit(standard[~held], truth[~held]).predict(standard[held])
    right = said == truth
    print(f"{len(flights)} flights, {moves.sum()} statistics, {FOLDS} folds of draws")
    print(f"top-1 {right[~healthy].sum()}/{(~healthy).sum()}", end="")
    for t in (1, 2, 4):
        those = ~healthy & (times == t)
        print(f", {t} times detectable {right[those].sum()}/{those.sum()}", end="")
    print(f"; false alarms {(~right[healthy]).sum()}/{healthy.sum()}")
    for effect in sorted(set(truth[~healthy])):
        those = truth == effect
        if right[those].mean() < 0.8:
            others = Counter(said[those & ~right]).most_common()
            print(f"{effect}: {right[those].sum()} of {those.sum()}, otherwise", end=" ")
            print(", ".join(f"{name} {count}" for name, count in others))


if __name__ == "__main__":
    main(sys.argv[1])
