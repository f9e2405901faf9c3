"""Takagi-Sugeno rules."""

import numpy as np
from numpy.typing import NDArray

from fitting.export.form import Form, Label, Operations, Table, labels, slopes
from fitting.modelfiles.columns import Column
from fitting.rules import RuleModel

# The largest exponent is taken off, as in `fitting.rules.firing_strengths`.
BODY = """\
    real exponent[RULES], largest = (real)0, weight, output, weights = (real)0, y = (real)0;
    int j, k;
    for (j = 0; j < RULES; ++j) {
        real square = (real)0;
        for (k = 0; k < USED; ++k) {
            const real z = (x[column[k]] - centre[j * USED + k]) * inverse_width[j * USED + k];
            square += z * z;
        }
        exponent[j] = (real)-0.5 * square;
        if (j == 0 || exponent[j] > largest)
            largest = exponent[j];
    }
    for (j = 0; j < RULES; ++j) {
        weight = REAL_EXP(exponent[j] - largest);
        output = consequent[j * (USED + 1)];
        for (k = 0; k < USED; ++k)
            output += consequent[j * (USED + 1) + k + 1] * x[column[k]];
        weights += weight;
        y += weight * output;
    }
    return y / weights;"""


def form(model: RuleModel, inputs: tuple[Column, ...], output: Column) -> Form:
    """y = sum_j w_j (a_j0 + sum_k a_jk x_k) / sum_j w_j, w_j = exp(-sum_k ((x_k - v_jk) / sigma_jk)^2 / 2)."""
    used = [inputs[k] for k in model.columns]
    rules, size = model.antecedents.centres.shape
    inverse = [Label(column.name, f"1/({column.unit})") for column in used]
    tables = (
        Table.of("column", labels(used, ""), model.columns, True),
        Table.of("centre", labels(used), model.antecedents.centres),
        Table.of("inverse_width", inverse, 1.0 / model.antecedents.widths),
        Table.of("consequent", slopes(used, output), model.consequents),
    )
    operations = Operations(
        adds=rules * (3 * size + 3), multiplies=rules * (3 * size + 2), divides=1, functions=rules, compares=rules
    )
    return Form(tables, {"RULES": rules, "USED": size}, BODY, operations, lambda rows: _magnitude(model, rows))


def _magnitude(model: RuleModel, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Products of the consequents, firing with the error of exp(-s/2), which is s/2 times that of s."""
    used = rows[:, model.columns]
    scaled = (used[:, np.newaxis] - model.antecedents.centres) / model.antecedents.widths
    squares = np.sum(scaled**2, axis=2)
    sizes = np.abs(model.consequents)
    products = sizes[:, 0] + np.abs(used) @ sizes[:, 1:].T
    magnitude: NDArray[np.float64] = np.sum(model.antecedents.firing(used).T * (1.0 + squares) * products, axis=1)
    return magnitude
