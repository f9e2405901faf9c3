"""The lag bank: Chebyshev in temperature, other features of history, products; linear outside its own guard."""

import numpy as np
from numpy.typing import NDArray

from fitting.export.form import Form, Label, Operations, Table, labels, slopes
from fitting.lag_bank_model import LagBankModel
from fitting.modelfiles.columns import Column

# How near its limit of 1 the leverage may be told differently by another precision.
_UNDECIDED = 2e-3

# `LagBankTerms.design`: T_m(z) / m^2, the others, the others times z
BODY = """\
    real term[TERMS > 0 ? TERMS : 1], y = constant[0], plain = fallback[0], leverage = (real)0;
    const real z = (x[0] - scaling[0]) / scaling[1];
    real before = (real)1, now = z, next;
    int i, j, inside = 1;
    for (j = 0; j < DEGREE; ++j) {
        term[j] = now / (real)((j + 1) * (j + 1));
        next = (real)2 * z * now - before;
        before = now;
        now = next;
    }
    for (j = 0; j < OTHERS; ++j) {
        const real other = (x[column[j]] - mean[j]) / deviation[j];
        term[DEGREE + j] = other;
        if (TERMS > DEGREE + OTHERS)
            term[DEGREE + OTHERS + j] = other * z;
    }
    for (j = 0; j < FEATURES; ++j) {
        plain += fallback[j + 1] * x[j];
        if (!(x[j] >= box_low[j] && x[j] <= box_high[j]))
            inside = 0;
    }
    for (i = 0; i < TERMS; ++i) {
        real sum = (real)0;
        for (j = 0; j < TERMS; ++j)
            sum += whitening[i * TERMS + j] * (term[j] - middle_of_terms[j]);
        leverage += sum * sum;
        y += coefficient[i] * term[i];
    }
    return inside && leverage <= (real)1 ? y : plain;"""


def form(model: LagBankModel, inputs: tuple[Column, ...], output: Column) -> Form:
    """y = constant + coefficients x terms, or the fallback where box or leverage say outside."""
    terms, guard = model.terms, model.guard
    others = [inputs[k] for k in terms.columns]
    names = _term_names(model, [column.name for column in others])
    of_terms, box = [Label(name) for name in names], labels(inputs)
    scaling = [Label("middle", inputs[0].unit), Label("half_range", inputs[0].unit)]
    tables = (
        Table.of("column", labels(others, ""), terms.columns, True),
        Table.of("scaling", scaling, [terms.middle, terms.half_range or 1.0]),
        Table.of("mean", labels(others), terms.mean),
        Table.of("deviation", labels(others), terms.std),
        Table.of("constant", [Label("constant", output.unit)], model.constant),
        Table.of("coefficient", [Label(name, output.unit) for name in names], model.coefficients),
        Table.of("fallback", slopes(inputs, output), model.fallback.coefficients),
        Table.of("box_low", box, guard.low),
        Table.of("box_high", box, guard.high),
        Table.of("middle_of_terms", of_terms, guard.centre),
        Table.of("whitening", of_terms, guard.whitening),
    )
    n, d, k = terms.count, len(others), len(inputs)
    operations = Operations(
        adds=1 + terms.degree + d + k + n * (2 * n + 2),
        multiplies=2 * terms.degree + (d if terms.cross else 0) + k + n * (n + 2),
        divides=1 + terms.degree + d,
        compares=2 * k + 1,
    )
    sizes = {"FEATURES": k, "TERMS": n, "DEGREE": terms.degree, "OTHERS": d}
    return Form(tables, sizes, BODY, operations, lambda rows: _magnitude(model, rows))


def _term_names(model: LagBankModel, others: list[str]) -> list[str]:
    terms = model.terms
    polynomial = [f"t{m}" for m in range(1, terms.degree + 1)]
    return [*polynomial, *others, *([f"{name} x t1" for name in others] if terms.cross else [])]


def _magnitude(model: LagBankModel, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sizes of the terms, of which T_m has a slope of up to m^2; infinite where rounding may decide what is outside."""
    design = model.terms.design(rows)
    leverage = np.sum(((design - model.guard.centre) @ model.guard.whitening.T) ** 2, axis=1)
    growth = np.ones(model.terms.count) * (2.0 + model.terms.count / 8.0)
    growth[: model.terms.degree] += np.arange(1, model.terms.degree + 1) ** 2
    inside = abs(model.constant) + (1.0 + np.abs(design)) @ (growth * np.abs(model.coefficients))
    plain = np.abs(model.fallback.coefficients)
    outside = plain[0] + np.abs(rows) @ plain[1:]
    sizes = np.where(model.inside(rows), inside, outside)
    return np.asarray(np.where(np.abs(leverage - 1.0) < _UNDECIDED, np.inf, sizes))
