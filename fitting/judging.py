"""Error models judged on named parts of the data: a cycle they never saw, another profile, the other half.

The models of `fitting.validation` predict a rate and are judged on splits of points; those here predict the error of a
gyro at rest and are judged on stretches of time series, each model on inputs of its own.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from fitting.validation import UNCOMPENSATED, Estimator, ValidationError

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
TRAIN = "train"


@dataclass(frozen=True)
class Candidate:
    """A model by its factory, and what it looks at: inputs (n, k); `grouped` if its fit takes groups."""

    make: Callable[[], Any]
    inputs: Floats
    grouped: bool = False


@dataclass(frozen=True)
class Part:
    """Rows (n,) to learn from, and the rows it is judged on by the name of the test."""

    train: Mask
    tests: Mapping[str, Mask]


@dataclass(frozen=True)
class Judgement:
    """Results of `judge`.

    metrics: model -> test -> {max_abs_dps, std_dps, bias_stability_dps, mae_dps, mse_dps2, floor_dps, n, fit_s,
        guarded}; 'train' are the rows of the first part learned from. The error is what is left: error minus predicted
        error. guarded: share of the rows outside the model's training range, None if it does not tell.
    residuals: row, model, split, predicted_dps, residual_dps.
    fitted: model -> the model fitted on the first part. warnings: model -> what its fit warned of.
    """

    metrics: dict[str, dict[str, dict[str, float | int | None]]]
    residuals: pd.DataFrame
    fitted: dict[str, Any]
    warnings: dict[str, list[str]]


def judge(
    candidates: Mapping[str, Candidate],
    error_dps: Floats,
    u_dps: Floats,
    parts: Sequence[Part],
    groups: NDArray[np.int64],
    seed: int = 0,
    timer: Callable[[], float] | None = None,
) -> Judgement:
    """Fit each candidate on every part and judge it on the part's tests.

    error_dps: (n,), output minus true rate. u_dps: (n,), its standard uncertainty. groups: (n,), what is left out
    together when a model tunes itself. Raises ValidationError for values that are not finite, a test without rows, or
    a model that fails.
    """
    _check(candidates, error_dps, u_dps, parts)
    metrics: dict[str, dict[str, dict[str, float | int | None]]] = {}
    blocks: list[pd.DataFrame] = []
    fitted: dict[str, Any] = {}
    said: dict[str, list[str]] = {}
    for name, candidate in {UNCOMPENSATED: None, **candidates}.items():
        metrics[name] = {}
        for number, part in enumerate(parts):
            tests = {TRAIN: part.train, **part.tests} if number == 0 else part.tests
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                model, fit_s = _fit(name, candidate, error_dps, part.train, groups, seed, timer)
            if caught:
                said[name] = list(dict.fromkeys([*said.get(name, ()), *(str(one.message) for one in caught)]))
            if number == 0 and candidate is not None:
                fitted[name] = model
            for test, rows in tests.items():
                left = error_dps[rows]
                predicted = np.zeros_like(left) if candidate is None else _predict(name, model, candidate.inputs[rows])
                guarded = None if candidate is None else _guarded(model, candidate.inputs[rows])
                metrics[name][test] = figures(left - predicted, u_dps[rows]) | {"fit_s": fit_s, "guarded": guarded}
                columns = {"row": np.flatnonzero(rows), "model": name, "split": test}
                blocks.append(pd.DataFrame(columns | {"predicted_dps": predicted, "residual_dps": left - predicted}))
    return Judgement(metrics, pd.concat(blocks, ignore_index=True), fitted, said)


def figures(residual_dps: Floats, u_dps: Floats) -> dict[str, float | int | None]:
    """Figures of what is left, (n,), beside the floor its noise sets: the rms of the standard uncertainties.

    bias_stability_dps: standard deviation with n - 1 of means that do not overlap, as GJB 2426A has it for rows that
    are averages of a stated time; std_dps: with n.

    >>> figures(np.array([1.0, -1.0]), np.array([0.5, 0.5]))["std_dps"]
    1.0
    """
    return {
        "max_abs_dps": float(np.abs(residual_dps).max()),
        "std_dps": float(residual_dps.std()),
        "bias_stability_dps": float(residual_dps.std(ddof=1)) if len(residual_dps) > 1 else None,
        "mae_dps": float(np.abs(residual_dps).mean()),
        "mse_dps2": float(np.mean(residual_dps**2)),
        "floor_dps": float(np.sqrt(np.mean(u_dps**2))),
        "n": len(residual_dps),
    }


def _check(candidates: Mapping[str, Candidate], error_dps: Floats, u_dps: Floats, parts: Sequence[Part]) -> None:
    arrays = {"error": error_dps, "u": u_dps} | {f"inputs of {name}": c.inputs for name, c in candidates.items()}
    for name, values in arrays.items():
        if len(values) != len(error_dps):
            raise ValidationError(f"{name} has {len(values)} rows, the error has {len(error_dps)}.")
        if not np.isfinite(values).all():
            raise ValidationError(f"{name} is not finite in some rows; leave these rows out first.")
    for part in parts:
        for test, rows in {TRAIN: part.train, **part.tests}.items():
            if not rows.any():
                raise ValidationError(f"'{test}' has no rows; is its record there, and long enough?")


def _fit(
    name: str,
    candidate: Candidate | None,
    error_dps: Floats,
    rows: Mask,
    groups: NDArray[np.int64],
    seed: int,
    timer: Callable[[], float] | None,
) -> tuple[Any, float | None]:
    """The model fitted on the rows, and the seconds it took."""
    if candidate is None:
        return None, None
    model = candidate.make()
    if "random_state" in model.get_params():
        model.set_params(random_state=seed)
    labels = groups[rows]
    more = {"groups": labels} if candidate.grouped and len(np.unique(labels)) > 1 else {}
    began = timer() if timer else None
    try:
        model.fit(candidate.inputs[rows], error_dps[rows], **more)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise ValidationError(f"model {name!r} could not be fitted to {rows.sum()} rows: {error}") from error
    return model, None if began is None or timer is None else timer() - began


def _predict(name: str, model: Estimator, inputs: Floats) -> Floats:
    predicted = np.asarray(model.predict(inputs), dtype=np.float64)
    if predicted.shape != (len(inputs),) or not np.isfinite(predicted).all():
        raise ValidationError(f"model {name!r} did not give one finite prediction per row.")
    return predicted


def _guarded(model: Any, inputs: Floats) -> float | None:
    """Share of rows the model itself says are outside its training range."""
    inside = getattr(model, "inside", None)
    return None if inside is None else float(1.0 - np.mean(inside(inputs)))
