"""Models of the bias over thermal cycles by name: what each looks at, and how it is made.

Static models see the temperatures alone, as the paper of `rlg` has it; the networks of `bp` see temperature and slope;
the lag bank sees what the gyro's past left in it (fitting notes, section 6).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.lag_bank_history import History
from fitting.modelfiles.columns import Column

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CycleModel:
    """make: a new estimator of the error. features: temperatures (n, k) of one whole record, and their period in s, to
    its inputs (n, d). inputs: names of the temperatures to names and units of these. grouped: its fit takes the number
    of the record of each row.
    """

    make: Callable[[], Any]
    features: Callable[[Floats, float], Floats]
    inputs: Callable[[Sequence[str]], tuple[Column, ...]]
    grouped: bool = False


def temperatures(temperatures_degc: Floats, period_s: float) -> Floats:
    """The temperatures as they are."""
    return temperatures_degc


def temperature_and_slope(temperatures_degc: Floats, period_s: float) -> Floats:
    """Mean temperature in degC and its causal slope over 100 s in degC/min."""
    features = History(time_constants_s=()).features(temperatures_degc, period_s)
    return features[:, [0, temperatures_degc.shape[1]]]


def history(temperatures_degc: Floats, period_s: float) -> Floats:
    """Mean temperature, differences between sensors, slope, and the mean less its low-passes."""
    return History().features(temperatures_degc, period_s)


def _as_they_are(names: Sequence[str]) -> tuple[Column, ...]:
    return tuple(Column(name.removesuffix("_degc"), "degC") for name in names)


def _with_slope(names: Sequence[str]) -> tuple[Column, ...]:
    return Column("temperature", "degC"), Column("slope", "degC/min")


def _of_history(names: Sequence[str]) -> tuple[Column, ...]:
    return tuple(
        Column("slope", "degC/min") if name == "slope_degc_min" else Column(name.removesuffix("_degc"), "degC")
        for name in History().names(len(names))
    )


def linear() -> CycleModel:
    """Linear in the temperatures, the paper's yardstick."""
    from fitting.linear import LinearCompensation

    return CycleModel(LinearCompensation, temperatures, _as_they_are)


def quadratic() -> CycleModel:
    """Second degree in the temperatures, lightly held back: with several sensors their differences stand for gradient
    and rate of temperature, so it is the paper's E = D_T dT + D_grad grad T + D_rate dT/dt with its first nonlinearity.
    """
    from fitting.polynomial import PolynomialCompensation

    return CycleModel(lambda: PolynomialCompensation(degree=2, ridge=1e-2), temperatures, _as_they_are)


def svr() -> CycleModel:
    """The paper's epsilon-SVR with its grid, coarse to fine."""
    from fitting.svr import SupportVectorRegression

    return CycleModel(SupportVectorRegression, temperatures, _as_they_are)


def bp_network() -> CycleModel:
    """The published network: gradient descent on temperature and slope."""
    from fitting.network import BackPropagationNetwork

    return CycleModel(BackPropagationNetwork, temperature_and_slope, _with_slope)


def csapso_published() -> CycleModel:
    """The published swarm, beyond its stability bound, then gradient descent."""
    from fitting.csapso import CsapsoNetwork

    return CycleModel(CsapsoNetwork, temperature_and_slope, _with_slope)


def csapso_stable() -> CycleModel:
    """The swarm with stable settings, finished by Levenberg-Marquardt."""
    from fitting.csapso import CsapsoNetwork

    return CycleModel(
        lambda: CsapsoNetwork(settings="stable", finish="levenberg_marquardt"), temperature_and_slope, _with_slope
    )


def lag_bank() -> CycleModel:
    """Chebyshev polynomial in temperature and the lag bank, by ridge."""
    from fitting.lag_bank import LagBankCompensation

    return CycleModel(LagBankCompensation, history, _of_history, grouped=True)


def lag_bank_gp() -> CycleModel:
    """A Gaussian process on the features of the lag bank."""
    from fitting.gaussian_process import GaussianProcess

    return CycleModel(GaussianProcess, history, _of_history)
