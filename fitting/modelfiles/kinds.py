"""Which kinds of model have a file format: their name in the file, the estimator saved, the module that does it."""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from types import MappingProxyType
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from fitting.strict_json import Refused


class Model(Protocol):
    """A model read from a file."""

    def predict(self, inputs: NDArray[np.float64]) -> NDArray[np.float64]:
        """Output for inputs (n, k): shape (n,); a row with a NaN gives NaN."""


class Codec(Protocol):
    """What a module of a kind offers; see the package."""

    def describe(self, estimator: Any) -> dict[str, Any]:
        """The parameters of a fitted estimator."""

    def build(self, parameters: Mapping[str, Any], n_inputs: int) -> Model:
        """The model that parameters describe."""


@dataclass(frozen=True)
class Kind:
    """estimator: 'module:Class' of what is saved as this kind. codec: the module that describes and builds it."""

    estimator: str
    codec: str

    def load(self) -> Codec:
        """The codec, imported on use."""
        return cast(Codec, import_module(self.codec))


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "linear": Kind("fitting.linear:LinearCompensation", "fitting.modelfiles.linear"),
        "takagi_sugeno": Kind("fitting.takagi_sugeno:TakagiSugeno", "fitting.modelfiles.takagi_sugeno"),
        "polynomial": Kind("fitting.polynomial:PolynomialCompensation", "fitting.modelfiles.polynomial"),
        "ls_svm": Kind("fitting.ls_svm:LeastSquaresSVM", "fitting.modelfiles.kernel"),
        "svr": Kind("fitting.svr:SupportVectorRegression", "fitting.modelfiles.kernel"),
        "gaussian_process": Kind("fitting.gaussian_process:GaussianProcess", "fitting.modelfiles.kernel"),
        "rbf": Kind("fitting.rbf:RadialBasisSpline", "fitting.modelfiles.kernel"),
        "network": Kind("fitting.network:BackPropagationNetwork", "fitting.modelfiles.network"),
        "csapso_network": Kind("fitting.csapso:CsapsoNetwork", "fitting.modelfiles.network"),
        "lag_bank": Kind("fitting.lag_bank:LagBankCompensation", "fitting.modelfiles.lag_bank"),
        "thermal_cycle": Kind("fitting.cycle_model:ThermalCycleCompensation", "fitting.modelfiles.thermal_cycle"),
    }
)


def kind_of(estimator: object) -> str:
    """The kind an estimator is saved as, by its class or a class it inherits from; TypeError if it has none."""
    for cls in type(estimator).__mro__:
        for name, kind in KINDS.items():
            if kind.estimator == f"{cls.__module__}:{cls.__qualname__}":
                return name
    raise TypeError(f"{type(estimator).__name__} is not a kind of model that has a file format")


def codec_of(kind: str) -> Codec:
    """The codec of a kind named in a file; `Refused` if it is not listed."""
    if kind not in KINDS:
        raise Refused(f"its kind is {kind[:40]!r}; known kinds: {', '.join(map(repr, KINDS))}")
    return KINDS[kind].load()


def known(uncertainty: NDArray[np.float64]) -> list[Any] | None:
    """Standard uncertainties as lists, or null where there were too few rows to estimate them."""
    return cast("list[Any]", uncertainty.tolist()) if np.isfinite(uncertainty).all() else None
