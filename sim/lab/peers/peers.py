"""Other people's methods on the sealed suite, scored by the same scorer (sim/lab/PROTOCOL.md).

Each method sees what the diagnosis sees: the bank of the mission, the accepted and the calibration
flights, and the statistics of the flight in question. It never sees a key. Every method comes twice,
with the settings a newcomer would take and with the best ones we found on the bank and the healthy
flights alone.

    haltere gap bank DIR/logs/commissioning-01-diagnostic.mcap --export bank.json
    haltere gap observe DIR/logs/*-diagnostic.mcap > observed.jsonl
    python peers.py bank.json observed.jsonl answers/
    haltere-lab blind DIR --answers answers/forest-best.jsonl
"""

import json
import sys
from pathlib import Path

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier, RandomForestClassifier
from sklearn.neighbors import KNeighborsClassifier

NO_GAP = "no gap"
# Share of healthy calibration flights that may raise an alarm, as in our own settings.
FALSE_ALARM = 0.03
# Deviations grow like their logarithm beyond this many sigma.
LARGE = 10.0
# Copies of a flight of the bank, each with the deviation of another accepted flight.
COPIES = 3
SEED = 7
# A statistic that never varies has no scale; it is left out below.
np.seterr(divide="ignore", invalid="ignore")


def rows(values):
    """Lists with null for unknown, as a matrix."""
    return np.array([[np.nan if v is None else v for v in row] for row in values], float)


class Data:
    """The bank, healthy flights, and flights in question."""

    def __init__(self, bank_file, observed_file):
        bank = json.loads(Path(bank_file).read_text())
        self.seeds, self.jitter = rows(bank["seeds"]), rows(bank["jitter"])
        self.x, self.y = [], []
        for effect in bank["effects"]:
            for draw in effect["draws"]:
                self.x.append(draw["statistics"])
                self.y.append(effect["id"])
        self.x, self.y = rows(self.x), np.array(self.y)
        flights = {}
        for line in Path(observed_file).read_text().splitlines():
            one = json.loads(line)
            if "names" in one:
                assert one["names"] == bank["names"], "bank and flights are of different builds"
            elif "statistics" in one:
                flights[Path(one["log"]).name.removesuffix("-diagnostic.mcap")] = one["statistics"]
        pick = lambda start: rows([v for k, v in sorted(flights.items()) if k.startswith(start)])
        self.accepted, self.calibration = pick("commissioning"), pick("calibration")
        self.ids = sorted(k for k in flights if k.startswith("case"))
        self.cases = rows([flights[k] for k in self.ids])


class Nominal:
    """Standardised by flights of the nominal simulator that differ by the seed alone."""

    def __init__(self, data):
        self.middle, self.scale = np.nanmean(data.seeds, 0), np.nanstd(data.seeds, 0)
        self.known = np.isfinite(self.scale) & (self.scale > 1e-12)

    def bank(self, x):
        return np.nan_to_num((x - self.middle) / self.scale)[:, self.known]

    flight = bank

    def taught(self, data):
        x = np.vstack([self.bank(data.x), self.bank(data.seeds)])
        return x, np.concatenate([data.y, np.full(len(data.seeds), NO_GAP)])


class Referenced:
    """Standardised by benign jitter and accepted flights; each world around its own middle."""

    def __init__(self, data):
        def spread(x):
            off = np.abs(x - np.nanmedian(x, 0))
            return np.maximum(1.4826 * np.nanmedian(off, 0), 0.3 * np.nanstd(x, 0))

        self.own, self.real = np.nanmedian(data.jitter, 0), np.nanmedian(data.accepted, 0)
        self.scale = np.hypot(spread(data.jitter), spread(data.accepted))
        self.known = np.isfinite(self.scale + self.real) & (self.scale > 1e-12)

    def compress(self, z):
        return (np.arcsinh(np.nan_to_num(z) / LARGE) * LARGE)[:, self.known]

    def bank(self, x):
        return self.compress((x - self.own) / self.scale)

    def flight(self, x):
        return self.compress((x - self.real) / self.scale)

    def taught(self, data):
        rng = np.random.default_rng(SEED)
        off = data.accepted - self.real
        add = lambda x: x + np.nan_to_num(off[rng.integers(0, len(off), len(x))])
        x = [self.bank(add(data.x)) for _ in range(COPIES)]
        x += [self.bank(add(data.jitter)) for _ in range(COPIES)]
        y = np.concatenate([data.y] * COPIES + [np.full(len(data.jitter), NO_GAP)] * COPIES)
        return np.vstack(x), y


def by_classifier(view, classifier):
    def method(data):
        classifier.fit(*view.taught(data))
        names = classifier.classes_
        none = np.flatnonzero(names == NO_GAP)[0]

        def judge(x):
            shares = classifier.predict_proba(view.flight(x))
            return names, shares, 1.0 - shares[:, none]

        return judge

    return method


def by_sparse_regression(view, keep, ridge):
    """Sequentially thresholded least squares (Brunton, Proctor, Kutz 2016) of a flight on the mean
    signatures of the library, both signs; the largest part of the explained square names."""

    def method(data):
        zero = view.bank(data.jitter).mean(0)
        names, signatures = [], []
        for effect in dict.fromkeys(data.y):
            z = view.bank(data.x[data.y == effect]) - zero
            # Signs and directions of an effect cancel in a mean: its first two directions.
            _, size, along = np.linalg.svd(z, full_matrices=False)
            for k in range(2):
                names.append(effect)
                signatures.append(along[k] * size[k] / np.sqrt(len(z)))
        a, names = np.array(signatures).T, np.array(names)

        def judge(x):
            effects = np.array(list(dict.fromkeys(names)))
            shares = np.zeros((len(x), len(effects)))
            seen = np.zeros(len(x))
            for i, z in enumerate(view.flight(x)):
                used = np.ones(len(names), bool)
                for _ in range(10):
                    m = a[:, used]
                    b = np.linalg.solve(m.T @ m + ridge * np.eye(m.shape[1]), m.T @ z)
                    part = np.abs(b) * np.linalg.norm(m, axis=0)
                    small = part < keep * part.max()
                    if not small.any():
                        break
                    used[np.flatnonzero(used)[small]] = False
                for name, size in zip(names[used], part):
                    shares[i, effects == name] += size**2
                seen[i] = shares[i].max()
            return effects, shares / np.maximum(shares.sum(1, keepdims=True), 1e-12), seen

        return judge

    return method


def answer(data, method, path):
    judge = method(data)
    # The gate from healthy flights that did not teach: the same flights that ours comes from.
    names, _, healthy = judge(data.calibration)
    gate = np.sort(healthy)[::-1][int(FALSE_ALARM * len(healthy))]
    names, shares, seen = judge(data.cases)
    effects = np.flatnonzero(names != NO_GAP)
    with open(path, "w") as out:
        for i, case in enumerate(data.ids):
            order = effects[np.argsort(-shares[i, effects], kind="stable")]
            total = max(shares[i, effects].sum(), 1e-12)
            ranked = [[str(names[k]), float(shares[i, k] / total)] for k in order]
            alarm = bool(seen[i] > gate)
            line = {"id": case, "ranked": ranked, "outcome": "named" if alarm else "no_gap"}
            line["effects"] = [ranked[0][0]] if alarm else []
            out.write(json.dumps(line) + "\n")


def main():
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    data = Data(sys.argv[1], sys.argv[2])
    folder = Path(sys.argv[3])
    folder.mkdir(parents=True, exist_ok=True)
    plain, best = Nominal(data), Referenced(data)
    methods = {
        "neighbours-default": by_classifier(plain, KNeighborsClassifier(5)),
        "neighbours-best": by_classifier(best, KNeighborsClassifier(5, weights="distance")),
        "forest-default": by_classifier(plain, RandomForestClassifier(random_state=SEED)),
        "forest-best": by_classifier(
            best, ExtraTreesClassifier(600, max_features=0.3, min_samples_leaf=2, random_state=SEED)
        ),
        "sparse-default": by_sparse_regression(plain, 0.1, 0.0001),
        "sparse-best": by_sparse_regression(best, 0.3, 1.0),
    }
    for name, method in methods.items():
        answer(data, method, folder / f"{name}.jsonl")
        print(name, flush=True)


if __name__ == "__main__":
    main()
