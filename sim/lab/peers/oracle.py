"""What the statistics could tell a diagnosis that has seen the other world.

A forest that learns labelled flights of the generator itself, judged on draws that it has not seen. The
diagnosis has only the nominal simulator to learn from, so this is no peer and no target: where this one fails,
the statistics do not say it; where only the diagnosis fails, the laws of the two worlds differ.

    haltere-lab detectable --draws 8 --labelled labelled.jsonl
    peers/bin/python sim/lab/peers/oracle.py labelled.jsonl

The same for pairs and unknown effects: one forest with a vote for every effect, which learns single flights and
sums of two, answers a suite. Its answers at a threshold of the vote, and those where every flight is said to
have two effects, are scored as any method's:

    peers/bin/python sim/lab/peers/oracle.py labelled.jsonl observed.jsonl answers/
    haltere-lab blind DIR --answers answers/oracle-two.jsonl
"""

import json
import os
import re
import sys
from collections import Counter

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier

FOLDS = 4
NONE = "none"
# Sigma at which sizes are compressed, as the diagnosis does.
KNEE = 8.0
# Sums of two flights that are learned; what of the second is below this many sigma is noise and left out.
SUMS = 6000
QUIET = 1.5
# Votes from which an effect is named.
THRESHOLDS = (0.2, 0.3)


def rows(values):
    return np.array([[np.nan if v is None else v for v in row] for row in values], float)


class Flights:
    """Labelled flights in sigma of the healthy ones."""

    def __init__(self, path):
        with open(path, encoding="utf-8") as lines:
            next(lines)
            flights = [json.loads(line) for line in lines]
        # X effects are not in the library: nothing could name them.
        flights = [
            f
            for f in flights
            if f["landed"] and f["whole"] and not (f["id"] or "").startswith("X")
        ]
        raw = rows(f["statistics"] for f in flights)
        self.truth = np.array([f["id"] or NONE for f in flights])
        self.times = np.array([f["times"] for f in flights])
        self.draws = np.array([f["draw"] for f in flights])
        self.healthy = self.truth == NONE
        self.use = np.isfinite(raw[self.healthy]).mean(0) > 0.8
        self.centre = np.nanmedian(raw[self.healthy], 0)
        self.scale = np.nanstd(raw[self.healthy], 0)
        self.use &= self.scale > 0
        self.z = self.standard(raw)

    def standard(self, raw):
        return np.nan_to_num(((raw - self.centre) / self.scale)[:, self.use])


def compressed(z):
    return KNEE * np.arcsinh(z / KNEE)


def names(flights):
    truth, healthy = flights.truth, flights.healthy
    said = np.empty(len(truth), object)
    for fold in range(FOLDS):
        held = flights.draws % FOLDS == fold
        forest = ExtraTreesClassifier(500, max_features=0.3, n_jobs=-1, random_state=1)
        said[held] = forest.fit(flights.z[~held], truth[~held]).predict(flights.z[held])
    right = said == truth
    print(f"{len(truth)} flights, {flights.use.sum()} statistics, {FOLDS} folds of draws")
    print(f"top-1 {right[~healthy].sum()}/{(~healthy).sum()}", end="")
    for t in (1, 2, 4):
        those = ~healthy & (flights.times == t)
        print(f", {t} times detectable {right[those].sum()}/{those.sum()}", end="")
    print(f"; false alarms {(~right[healthy]).sum()}/{healthy.sum()}")
    for effect in sorted(set(truth[~healthy])):
        those = truth == effect
        if right[those].mean() < 0.8:
            others = Counter(said[those & ~right]).most_common()
            print(f"{effect}: {right[those].sum()} of {those.sum()}, otherwise", end=" ")
            print(", ".join(f"{name} {count}" for name, count in others))


def votes(flights, effects, z):
    """Votes for every effect on flights `z`, by a forest that learned single flights and sums of two."""
    place = {effect: k for k, effect in enumerate(effects)}
    alone = np.zeros((len(flights.truth), len(effects)))
    for k, effect in enumerate(flights.truth):
        if effect != NONE:
            alone[k, place[effect]] = 1
    rng = np.random.default_rng(1)
    ill = np.flatnonzero(~flights.healthy)
    a, b = rng.choice(ill, SUMS), rng.choice(ill, SUMS)
    # As the suite's pairs: two effects, never of the same severity.
    apart = (flights.truth[a] != flights.truth[b]) & (flights.times[a] != flights.times[b])
    a, b = a[apart], b[apart]
    second = flights.z[b]
    second = second * np.clip(1 - (QUIET / np.maximum(np.abs(second), 1e-9)) ** 2, 0, None)
    # Single flights count four times: there are many more sums than flights.
    x = np.vstack([flights.z] * 4 + [flights.z[a] + second])
    y = np.vstack([alone] * 4 + [alone[a] + alone[b]])
    forest = ExtraTreesClassifier(
        300, max_features=0.3, min_samples_leaf=2, n_jobs=-1, random_state=1
    ).fit(compressed(x), y)
    return np.array([p[:, 1] for p in forest.predict_proba(compressed(z))]).T


def answers(flights, observed, folder):
    with open(observed, encoding="utf-8") as lines:
        next(lines)
        seen = [json.loads(line) for line in lines]
    cases = [re.search(r"(case-\d+)-diagnostic", f["log"]) for f in seen]
    seen = [f for f, case in zip(seen, cases) if case]
    cases = [case[1] for case in cases if case]
    effects = sorted(set(flights.truth[~flights.healthy]))
    found = votes(flights, effects, flights.standard(rows(f["statistics"] for f in seen)))

    def line(case, p, named):
        best = sorted(zip(effects, p), key=lambda v: -v[1])
        outcome = ("no_gap", "named", "several")[len(named)]
        ranked = [[effect, float(v)] for effect, v in best]
        return dict(
            id=case, outcome=outcome, effects=named, ranked=ranked, adequacy=float(1 - best[0][1])
        )

    def write(name, chosen):
        path = os.path.join(folder, f"oracle-{name}.jsonl")
        with open(path, "w", encoding="utf-8") as out:
            for case, p in zip(cases, found):
                two = [effects[k] for k in np.argsort(-p)[:2]]
                out.write(json.dumps(line(case, p, chosen(two, np.sort(p)[::-1]))) + "\n")
        print(path)

    os.makedirs(folder, exist_ok=True)
    for threshold in THRESHOLDS:
        write(
            f"{threshold}",
            lambda two, p, least=threshold: [e for e, v in zip(two, p) if v >= least],
        )
    write("two", lambda two, p: two)


if __name__ == "__main__":
    if len(sys.argv) == 2:
        names(Flights(sys.argv[1]))
    elif len(sys.argv) == 4:
        answers(Flights(sys.argv[1]), sys.argv[2], sys.argv[3])
    else:
        sys.exit(__doc__)
