"""Networks of one hidden layer."""

import numpy as np
from numpy.typing import NDArray

from fitting.export.form import Form, Label, Operations, Table, labels
from fitting.modelfiles.columns import Column
from fitting.network_core import NetworkModel

_IN_C = {"sigmoid": "(real)1 / ((real)1 + REAL_EXP(-sum))", "tanh": "REAL_TANH(sum)"}

BODY = """\
    real z[USED > 0 ? USED : 1], y = output_weight[HIDDEN];
    int j, k;
    for (k = 0; k < USED; ++k)
        z[k] = (x[column[k]] - mean[k]) / deviation[k];
    for (j = 0; j < HIDDEN; ++j) {
        real sum = threshold[j];
        for (k = 0; k < USED; ++k)
            sum += hidden_weight[j * USED + k] * z[k];
        y += output_weight[j] * (@ACTIVATION@);
    }
    for (k = 0; k < PATHS; ++k)
        y += output_weight[HIDDEN + 1 + k] * z[k];
    return output_scaling[0] + output_scaling[1] * y;"""


def form(model: NetworkModel, inputs: tuple[Column, ...], output: Column) -> Form:
    """y = mean + std (v_0 + sum_j v_j s(b_j + sum_k w_jk z_k) + sum_k l_k z_k), z = (x - mean) / std."""
    shape, scaling = model.shape, model.scaling
    used = [inputs[k] for k in scaling.columns]
    plain = labels(used, "")
    into, thresholds = shape.hidden_weights(model.weights)
    tables = (
        Table.of("column", plain, scaling.columns, True),
        Table.of("mean", labels(used), scaling.mean),
        Table.of("deviation", labels(used), scaling.std),
        Table.of("hidden_weight", plain, into),
        Table.of("threshold", [Label("threshold", "")], thresholds),
        Table.of("output_weight", [Label("weight", "")], model.weights[shape.nonlinear :]),
        Table.of(
            "output_scaling",
            [Label("shift", output.unit), Label("scale", output.unit)],
            [model.target_mean, model.target_std],
        ),
    )
    size, hidden = len(used), shape.hidden
    paths = size if shape.linear_path else 0
    sigmoid = int(shape.activation == "sigmoid")
    operations = Operations(
        adds=size + hidden * (size + 1 + sigmoid) + paths + 1,
        multiplies=hidden * (size + 1) + paths + 1,
        divides=size + hidden * sigmoid,
        functions=hidden,
    )
    sizes = {"USED": size, "HIDDEN": hidden, "PATHS": paths}
    body = BODY.replace("@ACTIVATION@", _IN_C[shape.activation])
    return Form(tables, sizes, body, operations, lambda rows: _magnitude(model, rows))


def _magnitude(model: NetworkModel, rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sizes of the output's terms, each hidden one with the error of its sum; sigmoid and tanh have a slope of <= 1."""
    shape, z = model.shape, np.abs(model.scaling.apply(rows))
    into, thresholds = (np.abs(part) for part in shape.hidden_weights(model.weights))
    linear = np.abs(model.weights[shape.nonlinear :])
    hidden = (1.0 + thresholds + z @ into.T) @ linear[: shape.hidden] + linear[shape.hidden]
    if shape.linear_path:
        hidden = hidden + z @ linear[shape.hidden + 1 :]
    magnitude: NDArray[np.float64] = abs(model.target_mean) + abs(model.target_std) * hidden
    return magnitude
