"""Polynomials in Chebyshev polynomials of the inputs."""

import numpy as np
from numpy.typing import NDArray

from fitting.export.form import Form, Label, Operations, Table, labels
from fitting.modelfiles.columns import Column
from fitting.polynomial import PolynomialModel

# T_0 = 1, T_1 = z, T_(m+1) = 2 z T_m - T_(m-1)
BODY = """\
    real value[(USED > 0 ? USED : 1) * (DEGREE + 2)], y = (real)0;
    int j, k, m;
    for (k = 0; k < USED; ++k) {
        real *const t = value + k * (DEGREE + 2);
        t[0] = (real)1;
        t[1] = (x[column[k]] - middle[k]) / half[k];
        for (m = 1; m < DEGREE; ++m)
            t[m + 1] = (real)2 * t[1] * t[m] - t[m - 1];
    }
    for (j = 0; j < TERMS; ++j) {
        real term = coefficient[j];
        for (k = 0; k < USED; ++k)
            term *= value[k * (DEGREE + 2) + power[j * USED + k]];
        y += term;
    }
    return y;"""


def form(model: PolynomialModel, inputs: tuple[Column, ...], output: Column) -> Form:
    """y = sum_j c_j prod_k T_(p_jk)(z_k), z = (x - middle) / half."""
    used = [inputs[k] for k in model.columns]
    plain = labels(used, "")
    tables = (
        Table.of("column", plain, model.columns, True),
        Table.of("middle", labels(used), model.middle),
        Table.of("half", labels(used), model.half),
        Table.of("power", plain, model.powers, True),
        Table.of("coefficient", [Label("coefficient", output.unit)], model.coefficients),
    )
    size, terms = len(used), len(model.coefficients)
    degree = int(model.powers.max(initial=0))
    steps = size * max(degree - 1, 0)
    operations = Operations(adds=size + steps + terms, multiplies=2 * steps + terms * size, divides=size)
    sizes = {"USED": size, "TERMS": terms, "DEGREE": degree}
    return Form(tables, sizes, BODY, operations, lambda rows: _magnitude(model, rows))


def _magnitude(model: PolynomialModel, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sizes of the coefficients; inside [-1, 1] a T_p is at most 1 and its slope at most p^2."""
    growth = 1.0 + len(model.coefficients) / 16.0 + np.sum(model.powers.astype(np.float64) ** 2, axis=1)
    return np.full(len(rows), float(np.abs(model.coefficients) @ growth))
