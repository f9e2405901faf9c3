"""Which models a recording is offered, and which of them are better than knowing less."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from bench.analyses.models import model_factories
from bench.errors import UserMistake
from bench.userdata.judging import LEFT_OUT, Figures, Folds, is_better, judge
from bench.userdata.recording import Recording
from fitting.automatic import AutomaticCompensation
from fitting.cycle_model import ThermalCycleCompensation
from fitting.lag_bank import LagBankCompensation
from fitting.lag_bank_history import AVERAGING_S, ThermalHistory
from fitting.linear import LinearCompensation
from fitting.modelfiles.columns import RATE
from fitting.polynomial import PolynomialCompensation

Make = Callable[[], Any]


@dataclass(frozen=True)
class Fitted:
    """One model: how it is made, which inputs it looks at, and what it got wrong on rows held back."""

    name: str
    make: Make
    columns: NDArray[np.intp]
    judged: dict[str, Figures]

    @property
    def left_out_dps(self) -> float:
        """Standard deviation of its errors on groups left out."""
        return self.judged[LEFT_OUT].std_dps


def judged_models(recording: Recording, folds: Folds, names: tuple[str, ...]) -> tuple[list[Fitted], list[str]]:
    """The models named, or the default for such a recording, each judged; and what is to be said about them.

    A model keeps its temperature if that helps, or if it was named. Raises UserMistake if one cannot be fitted.
    """
    if names:
        models = [_judged(name, make, recording, folds) for name, make in model_factories(names).items()]
    elif not recording.temperatures:
        return [_without_temperature(recording, folds)], []
    elif recording.output == RATE:
        models = [_chosen(recording, folds)]
    else:
        models = [_judged("lag_bank", LagBankCompensation, recording, folds)]
    notes = list[str]()
    if recording.temperatures:
        models, notes = _with_reason(models, recording, folds, named=bool(names))
    if not names and recording.period_s is not None:
        models, note = _with_history(models[0], recording, folds)
        notes.append(note)
    return models, notes


def _chosen(recording: Recording, folds: Folds) -> Fitted:
    """Kind and complexity chosen on all rows by leaving out groups; then judged as if they had been known."""
    try:
        found = AutomaticCompensation().fit(recording.inputs, recording.target, groups=folds.groups)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise UserMistake(f"{recording.path}: no model could be chosen: {error}") from error
    return _judged(found.chosen_, lambda: clone(found.best_estimator_), recording, folds)


def _with_reason(
    models: list[Fitted], recording: Recording, folds: Folds, named: bool
) -> tuple[list[Fitted], list[str]]:
    """In place of each model that gains nothing by the temperature one without it, unless it was named."""
    plain = _without_temperature(recording, folds)
    kept, notes = list[Fitted](), list[str]()
    for full in models:
        if is_better(full.judged[LEFT_OUT], plain.judged[LEFT_OUT]):
            kept.append(full)
            continue
        kept.append(full if named else plain)
        notes.append(
            f"{full.name} finds no temperature effect: std left out {full.left_out_dps:.3g} deg/s with temperature, "
            f"{plain.left_out_dps:.3g} without; "
            + ("it is kept because it was named" if named else "the model has no temperature term")
        )
    return kept, notes


def _with_history(now: Fitted, recording: Recording, folds: Folds) -> tuple[list[Fitted], str]:
    """Of a gyro at rest, sampled evenly: the lag bank on the temperatures' past, if that is better than the present."""
    period_s = recording.period_s
    assert period_s is not None
    slope_over_s = max(AVERAGING_S, period_s)
    features = ThermalHistory(period_s, slope_over_s=slope_over_s).fit_transform(recording.inputs)
    everything = np.arange(recording.inputs.shape[1])
    past = Fitted(
        "lag_bank_history",
        lambda: ThermalCycleCompensation(period_s=period_s, slope_over_s=slope_over_s),
        everything,
        _judge("lag_bank_history", LagBankCompensation, recording, folds, features),
    )
    helps = is_better(past.judged[LEFT_OUT], now.judged[LEFT_OUT])
    note = (
        f"the history of the temperature {'helps' if helps else 'does not help'}: std left out "
        f"{past.left_out_dps:.3g} deg/s with it, {now.left_out_dps:.3g} without"
    )
    return [past if helps else now], note


def _without_temperature(recording: Recording, folds: Folds) -> Fitted:
    """The true rate from the rate alone, by a straight line unless a polynomial is better; at rest, the mean error."""
    if recording.output != RATE:
        return _judged("mean", _mean, recording, folds)
    columns = np.arange(recording.temperatures, len(recording.columns))
    line = _judged("linear", LinearCompensation, recording, folds, columns)
    curve = _judged("polynomial", _curve, recording, folds, columns)
    return curve if is_better(curve.judged[LEFT_OUT], line.judged[LEFT_OUT]) else line


def _mean() -> PolynomialCompensation:
    return PolynomialCompensation(degree=0)


def _curve() -> PolynomialCompensation:
    """Saturation is odd in the rate; the fifth power covers what a sine of it leaves of the third."""
    return PolynomialCompensation(degree=5)


def _judged(
    name: str, make: Make, recording: Recording, folds: Folds, columns: NDArray[np.intp] | None = None
) -> Fitted:
    used = np.arange(len(recording.columns)) if columns is None else columns
    return Fitted(name, make, used, _judge(name, make, recording, folds, recording.inputs[:, used]))


def _judge(
    name: str, make: Make, recording: Recording, folds: Folds, inputs: NDArray[np.float64]
) -> dict[str, Figures]:
    try:
        return judge(make, inputs, recording.target, folds)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        raise UserMistake(f"{recording.path}: model '{name}' could not be fitted: {error}") from error
