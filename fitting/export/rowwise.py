"""Code of models whose output depends on the row alone."""

from fitting.export import guard, templates
from fitting.export.form import Pieces
from fitting.export.forms import form_of
from fitting.export.precision import Precision
from fitting.export.selftest import vector
from fitting.export.text import real_array, whole_array
from fitting.modelfile import Compensation
from fitting.modelfiles.columns import RATE, RATE_INPUT


def pieces(compensation: Compensation, precision: Precision) -> Pieces:
    """What is particular to it; compensation: as `in_precision` gives it."""
    form = form_of(compensation.model, compensation.inputs, compensation.output)
    tests = vector(compensation, form, precision)
    selftest = {
        "TESTS": str(len(tests.rows)),
        "TEST_DATA": "\n".join(
            [
                real_array("test_row", tests.rows, precision),
                real_array("test_expected", tests.expected, precision),
                real_array("test_tolerance", tests.tolerance, precision),
                whole_array("test_outside", tests.outside),
            ]
        ),
    }
    words = {
        "STATE": "",
        "PASS": "",
        "STATE_DECLARED": "",
        "HOW": "",
        "EVALUATE": templates.EVALUATE,
        "OUTSIDE": _going_on(compensation, precision),
        "SELFTEST_BODY": templates.SELFTEST_BODY,
    }
    operations = form.operations + guard.operations(compensation)
    return Pieces(form, words | selftest, operations, float(tests.tolerance.max()))


def _going_on(compensation: Compensation, precision: Precision) -> str:
    """A rate goes on from the edge of the range, as in `Compensation.guarded`."""
    if compensation.output != RATE:
        return ""
    rate, slope = compensation.inputs.index(RATE_INPUT), precision.literal(compensation.rate_slope)
    return f"    if (outside)\n        y += (real){slope} * (x[{rate}] - held[{rate}]);\n"
