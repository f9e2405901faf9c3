"""Linear models."""

import numpy as np

from fitting.export.form import Form, Operations, Table, slopes
from fitting.linear import LinearModel
from fitting.modelfiles.columns import Column

BODY = """\
    real y = coefficient[0];
    int k;
    for (k = 0; k < TERMS; ++k)
        y += coefficient[k + 1] * x[k];
    return y;"""


def form(model: LinearModel, inputs: tuple[Column, ...], output: Column) -> Form:
    """y = c_0 + sum_k c_k x_k."""
    sizes = np.abs(model.coefficients)
    return Form(
        (Table.of("coefficient", slopes(inputs, output), model.coefficients),),
        {"TERMS": len(inputs)},
        BODY,
        Operations(adds=len(inputs), multiplies=len(inputs)),
        lambda rows: sizes[0] + np.abs(rows) @ sizes[1:],
    )
