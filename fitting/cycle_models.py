"""Models of the bias over thermal cycles by name: what each looks at, and how it is made.

Static models see the temperatures alone, as the paper of `rlg` has it; the networks of `bp` see temperature and slope;
the lag bank sees what the gyro's past left in it (fitting notes, section 6).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fitting.lag_bank_history import History

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CycleModel:
    """make: a new estimator of the error. features: temperatures (n, k) of one whole record, and their period in s, to
    its inputs (n, d). grouped: its fit takes the number of the record of each row.
    """

    make: Callable[[], Any]
    features: Callable[[Floats, float], Floats]
    grouped: bool = False


def temperatures(temperatures_degc: Floats, period_s: float) -> Floats:
    """The temperatures as they are."""
    return temperatures_degc


def temperature_and_slope(temperatures_degc: Floats, period_s: float) -> Floats:
    """Mean temperature in degC and its causal slope in degC/min."""
    history = History(time_constants_s=(), slope_over_s=period_s)
    features = history.features(temperatures_degc, period_s)
    return features[:, [0, temperatures_degc.shape[1]]]


def history(temperatures_degc: Floats, period_s: float) -> Floats:
    """Mean temperature, differences between sensors, slope, and the mean less its low-passes."""
    return History(slope_over_s=period_s).features(temperatures_degc, period_s)


def linear() -> CycleModel:
    """Linear in the temperatures, the paper's yardstick."""
    from fitting.linear import LinearCompensation

    return CycleModel(LinearCompensation, temperatures)


def svr() -> CycleModel:
    """The paper's epsilon-SVR with its grid, coarse to fine."""
    from fitting.svr import SupportVectorRegression

    return CycleModel(SupportVectorRegression, temperatures)


def bp_network() -> CycleModel:
    """The published network: gradient descent on temperature and slope."""
    from fitting.network import BackPropagationNetwork

    return CycleModel(BackPropagationNetwork, temperature_and_slope)


def csapso_published() -> CycleModel:
    """The published swarm, beyond its stability bound, then gradient descent."""
    from fitting.csapso import CsapsoNetwork

    return CycleModel(CsapsoNetwork, temperature_and_slope)


def csapso_stable() -> CycleModel:
    """The swarm with stable settings, finished by Levenberg-Marquardt."""
    from fitting.csapso import CsapsoNetwork

    return CycleModel(lambda: CsapsoNetwork(settings="stable", finish="levenberg_marquardt"), temperature_and_slope)


def lag_bank() -> CycleModel:
    """Chebyshev polynomial in temperature and the lag bank, by ridge."""
    from fitting.lag_bank import LagBankCompensation

    return CycleModel(LagBankCompensation, history, grouped=True)


def lag_bank_gp() -> CycleModel:
    """A Gaussian process on the features of the lag bank."""
    from fitting.gaussian_process import GaussianProcess

    return CycleModel(GaussianProcess, history)
