"""Sums of kernels around training rows plus a polynomial: LS-SVM, SVR, Gaussian process, RBF."""

import numpy as np
from numpy.typing import NDArray

from fitting.export.form import Form, Label, Operations, Table, labels
from fitting.kernels import KERNELS, KernelModel, monomials, squared_distances
from fitting.modelfiles.columns import Column

# of the squared distance, as in `fitting.kernels`
_IN_C = {"gaussian": "REAL_EXP((real)-0.5 * square)", "quintic": "-square * square * REAL_SQRT(square)"}

BODY = """\
    real z[USED > 0 ? USED : 1], trend = (real)0, kernels = (real)0;
    int i, j, k, p;
    for (k = 0; k < USED; ++k)
        z[k] = (x[column[k]] - shift[k]) / scale[k];
    for (j = 0; j < TERMS; ++j) {
        real term = coefficient[j];
        for (k = 0; k < USED; ++k)
            for (p = 0; p < power[j * USED + k]; ++p)
                term *= z[k];
        trend += term;
    }
    for (i = 0; i < SUPPORTS; ++i) {
        real square = (real)0;
        for (k = 0; k < USED; ++k) {
            const real d = z[k] - support[i * USED + k];
            square += d * d;
        }
        kernels += weight[i] * (@KERNEL@);
    }
    return output_scaling[0] + output_scaling[1] * (trend + kernels);"""


def form(model: KernelModel, inputs: tuple[Column, ...], output: Column) -> Form:
    """y = shift + scale (sum_j b_j prod_k z_k^p_jk + sum_i a_i K(|z - s_i|)), z = (x - shift) / scale."""
    used = [inputs[k] for k in model.columns]
    plain = labels(used, "")
    scaling = [Label("shift", output.unit), Label("scale", output.unit)]
    tables = (
        Table.of("column", plain, model.columns, True),
        Table.of("shift", labels(used), model.shift),
        Table.of("scale", labels(used), model.scale),
        Table.of("support", plain, model.supports),
        Table.of("weight", [Label("weight", "")], model.weights),
        Table.of("power", plain, model.powers, True),
        Table.of("coefficient", [Label("coefficient", "")], model.coefficients),
        Table.of("output_scaling", scaling, [model.output_shift, model.output_scale]),
    )
    size, supports, terms = len(used), len(model.weights), len(model.powers)
    each = Operations(adds=2 * size + 1, multiplies=size + 2 + 2 * (model.kernel == "quintic"), functions=1)
    operations = Operations(
        adds=size + terms + supports * each.adds + 2,
        multiplies=int(model.powers.sum()) + supports * each.multiplies + 1,
        divides=size,
        functions=supports,
    )
    sizes = {"USED": size, "TERMS": terms, "SUPPORTS": supports}
    body = BODY.replace("@KERNEL@", _IN_C[model.kernel])
    return Form(tables, sizes, body, operations, lambda rows: _magnitude(model, rows))


def _magnitude(model: KernelModel, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sizes of all terms; a kernel's argument is off by |d| |z| roundings, and the kernels are summed in one row."""
    z = model.scaled(rows)
    squares = squared_distances(z, model.supports)
    moved = squares + np.sqrt(squares) * np.sqrt(np.sum(z**2, axis=1))[:, np.newaxis]
    kernels = np.abs(KERNELS[model.kernel](squares.copy()))
    steeper = 1.0 + moved if model.kernel == "gaussian" else 1.0 + 5.0 * moved / np.maximum(squares, 1e-30)
    sums = (kernels * steeper) @ np.abs(model.weights) * (1.0 + len(model.weights) / 16.0)
    trend = np.abs(monomials(z, model.powers)) @ (np.abs(model.coefficients) * (1.0 + model.powers.sum(axis=1)))
    magnitude: NDArray[np.float64] = abs(model.output_shift) + abs(model.output_scale) * (sums + trend)
    return magnitude
