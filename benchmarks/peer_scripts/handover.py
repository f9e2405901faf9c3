"""What a peer's script does with the data it is handed; numpy and the standard library only, old ones too.

    PYTHON SCRIPT METHOD DATA.npz RESULTS.jsonl SETS

DATA has train_inputs (sets, n, 2), [temperature in degC, rate as the gyro gave it in deg/s], train_rate_dps (sets, n)
and test_inputs (sets, m, 2). The true rates of the test rows are not in it: the errors are computed by whoever started
the script. RESULTS gets one line a set as soon as it is fitted, so that a script that is stopped loses only the rest.
"""

import json
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from time import process_time
from typing import Any, Protocol

import numpy as np

# Quick fits are repeated, and the quickest counts: the first one pays for what the library loads on first use.
REPETITIONS, ENOUGH_S = 3, 1.0


class Model(Protocol):
    """fit(X (n, 2), y (n,)) and predict(X), as in scikit-learn."""

    def fit(self, X: Any, y: Any) -> Any: ...

    def predict(self, X: Any) -> Any: ...


class Correction:
    """A method that wants z-scores on both sides; it learns the correction, fifty times smaller than the rate."""

    def __init__(self, inner: Model) -> None:
        self.inner = inner

    def fit(self, X: Any, y: Any) -> "Correction":
        correction = y - X[:, 1]
        self.mean, self.std = X.mean(axis=0), X.std(axis=0)
        self.target_mean, self.target_std = correction.mean(), correction.std()
        self.inner.fit((X - self.mean) / self.std, (correction - self.target_mean) / self.target_std)
        return self

    def predict(self, X: Any) -> Any:
        predicted = np.ravel(self.inner.predict((X - self.mean) / self.std))
        return X[:, 1] + self.target_mean + self.target_std * predicted


def fitted(make: Callable[[], Model], inputs: Any, rate: Any) -> tuple[Model, float]:
    """The model and the processor time of its fit in s: other programs on the machine do not count."""
    times: list[float] = []
    while len(times) < REPETITIONS and sum(times) < ENOUGH_S:
        model = make()
        started = process_time()
        model.fit(inputs, rate)
        times.append(process_time() - started)
    return model, min(times)


def main(package: str, methods: dict[str, Callable[[], Model]]) -> None:
    """Fit the method named on the command line to the first sets; package: whose version is reported."""
    method, data, results, sets = sys.argv[1:]
    version = metadata.version(package)
    with np.load(data) as arrays, Path(results).open("w", encoding="utf-8") as lines:
        handed = [arrays[name] for name in ("train_inputs", "train_rate_dps", "test_inputs")]
        for train_inputs, train_rate, test_inputs in list(zip(*handed))[: int(sets)]:  # noqa: B905
            model, fit_s = fitted(methods[method], train_inputs, train_rate)
            predicted = np.ravel(model.predict(test_inputs)).astype(float).tolist()
            lines.write(json.dumps({"version": version, "fit_s": fit_s, "predicted_dps": predicted}) + "\n")
            lines.flush()
