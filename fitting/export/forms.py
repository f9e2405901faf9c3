"""Which forms of model leave Python as C and tables: the class of the model, and the module that says how."""

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Protocol, cast

from fitting.export.form import Form
from fitting.modelfiles.columns import Column
from fitting.modelfiles.kinds import Model


class NotExported(ValueError):
    """A kind of model that has no form in C; the message says which have."""


class _Module(Protocol):
    """What a module of a form offers."""

    def form(self, model: Model, inputs: tuple[Column, ...], output: Column) -> Form:
        """The model's form."""


# One class serves several kinds: LS-SVM, SVR, Gaussian process and spline are all sums of kernels.
FORMS: Mapping[str, str] = MappingProxyType(
    {
        "fitting.linear:LinearModel": "fitting.export.linear",
        "fitting.polynomial:PolynomialModel": "fitting.export.polynomial",
        "fitting.rules:RuleModel": "fitting.export.rules",
        "fitting.kernels:KernelModel": "fitting.export.kernel_sum",
        "fitting.network_core:NetworkModel": "fitting.export.network",
        "fitting.lag_bank_model:LagBankModel": "fitting.export.lag_bank",
    }
)


def form_of(model: Model, inputs: tuple[Column, ...], output: Column) -> Form:
    """The form of a model; `NotExported` for one that has none."""
    cls = type(model)
    module = FORMS.get(f"{cls.__module__}:{cls.__qualname__}")
    if module is None:
        able = ", ".join(path.rpartition(".")[2] for path in FORMS.values())
        raise NotExported(
            f"a {cls.__qualname__} is not exported to C or tables; those that are: {able}, and thermal cycles of one "
            "of these. Take the model file itself (json), or fit another model."
        )
    return cast(_Module, import_module(module)).form(model, inputs, output)
