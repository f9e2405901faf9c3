"""Error models judged on named parts: who learns from what, and what the figures say."""

from typing import Any

import numpy as np
import pytest

from fitting.judging import Candidate, Part, figures, judge
from fitting.linear import LinearCompensation
from fitting.validation import ValidationError
from tests.fitting import twins


class Remembers:
    """Predicts the mean of what it was given, and keeps it."""

    seen: list[tuple[Any, Any]]

    def __init__(self, log: list[tuple[Any, Any]]) -> None:
        self.log = log

    def get_params(self) -> dict[str, Any]:
        return {}

    def fit(self, X: Any, y: Any, groups: Any = None) -> None:
        self.mean = float(np.mean(y))
        self.log.append((len(y), groups))

    def predict(self, X: Any) -> Any:
        return np.full(len(X), self.mean)

    def inside(self, X: Any) -> Any:
        return X[:, 0] < 4.0


ERROR = np.array([1.0, 3.0, 5.0, 7.0, 2.0, 4.0])
U = np.full(6, 0.5)
FIRST = np.array([1, 1, 1, 1, 0, 0], bool)
GROUPS = np.array([0, 0, 1, 1, 2, 2])


def test_each_part_is_learned_and_judged_by_itself() -> None:
    log: list[tuple[Any, Any]] = []
    candidate = Candidate(lambda: Remembers(log), np.arange(6.0)[:, np.newaxis], grouped=True)
    parts = [Part(FIRST, {"other": ~FIRST}), Part(GROUPS == 0, {"half": GROUPS == 1})]
    found = judge({"mean": candidate}, ERROR, U, parts, GROUPS)
    assert [size for size, _ in log] == [4, 2]
    # one group alone leaves nothing to leave out
    np.testing.assert_array_equal(log[0][1], [0, 0, 1, 1])
    assert log[1][1] is None
    assert set(found.metrics["mean"]) == {"train", "other", "half"}
    assert found.metrics["mean"]["other"]["max_abs_dps"] == 2.0  # 2 - 4 and 4 - 4
    assert found.metrics["mean"]["half"]["mae_dps"] == 4.0  # 5 and 7 - 2
    assert found.metrics["mean"]["other"]["guarded"] == 1.0 and found.metrics["mean"]["train"]["guarded"] == 0.0
    assert found.metrics["none"]["other"]["std_dps"] == 1.0 and found.metrics["none"]["other"]["floor_dps"] == 0.5
    rows = found.residuals.query("model == 'mean' and split == 'other'")
    assert rows["row"].tolist() == [4, 5] and rows["residual_dps"].tolist() == [-2.0, 0.0]
    assert found.fitted["mean"].mean == 4.0


def test_the_figures_are_those_of_their_definitions() -> None:
    found = figures(np.array([1.0, -3.0]), np.array([1.0, 2.0]))
    assert found == {
        "max_abs_dps": 3.0,
        "std_dps": 2.0,
        "bias_stability_dps": pytest.approx(np.sqrt(8.0)),
        "mae_dps": 2.0,
        "mse_dps2": 5.0,
        "floor_dps": pytest.approx(np.sqrt(2.5)),
        "n": 2,
    }


@pytest.mark.parametrize(
    ("error", "parts", "message"),
    [
        (np.array([1.0, np.nan, 1, 1, 1, 1]), [Part(FIRST, {})], "error is not finite"),
        (ERROR, [Part(FIRST, {"other": np.zeros(6, bool)})], "'other' has no rows"),
        (ERROR[:5], [Part(FIRST[:5], {})], "rows"),
    ],
)
def test_what_cannot_be_judged(error: Any, parts: list[Part], message: str) -> None:
    candidates = {"linear": Candidate(LinearCompensation, np.arange(6.0)[:, np.newaxis])}
    with pytest.raises(ValidationError, match=message):
        judge(candidates, error, U[: len(error)], parts, GROUPS[: len(error)])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_lag_bank_reaches_the_floor_of_another_cycle(seed: int) -> None:
    """Issue table, `bp`: other cycle within 1.2 white floors; the published network stays far above."""
    from fitting.cycle_models import lag_bank

    cycles = [twins.bp(seed, 0), twins.bp(seed, 1)]
    model = lag_bank()
    labels = np.repeat([0, 1], [len(one.bias_dph) for one in cycles])
    error = np.concatenate([one.bias_dph for one in cycles]) / 3600.0
    inputs = np.vstack([model.features(one.temperatures_degc, 100.0) for one in cycles])
    floor = np.full(len(error), cycles[0].floor_dph / 3600.0)
    candidate = Candidate(model.make, inputs, model.grouped)
    found = judge({"lag_bank": candidate}, error, floor, [Part(labels == 0, {"other": labels == 1})], labels).metrics
    raw, left = (found[name]["other"]["std_dps"] for name in ("none", "lag_bank"))
    assert raw is not None and left is not None
    assert raw > 7.0 * floor[0] and left <= 1.2 * floor[0]
