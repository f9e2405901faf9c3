"""A model as one header and one source file of C99 that need nothing but math.h."""

from dataclasses import dataclass

from fitting.cycle_model import ThermalCycleModel
from fitting.export import guard, rowwise, stream
from fitting.export.form import Operations, Pieces, Table
from fitting.export.precision import DOUBLE, Precision, in_precision
from fitting.export.templates import COMPENSATE, COMPENSATE_DECLARED, HEADER, SELFTEST, SOURCE
from fitting.export.text import comment, fill, table_checks, table_text
from fitting.modelfile import Compensation
from fitting.modelfiles.columns import RATE

# Words that hold words, one inside the other, in this order.
_NESTED = ("STATE", "HOW", "STATE_DECLARED", "COMPENSATE_DECLARED", "COMPENSATE", "EVALUATE", "SELFTEST_BODY")


@dataclass(frozen=True)
class Exported:
    """Files by name; what they hold and cost. largest_rounding: of the self-test's outputs, in the output's unit."""

    name: str
    files: dict[str, str]
    coefficients: int
    coefficient_bytes: int
    operations: Operations
    largest_rounding: float

    @property
    def source(self) -> str:
        """Name of the source file."""
        return f"{self.name}.c"


def export_c(compensation: Compensation, name: str, precision: Precision = DOUBLE) -> Exported:
    """Write a model as C under a name (see `fitting.export.text.identifier`); `NotExported` for one that has no C."""
    rounded = in_precision(compensation, precision)
    pieces, tables = _parts(rounded, precision)
    stem = name + precision.mark
    words = {
        **_words(rounded, stem, precision),
        **pieces.words,
        **table_checks(tables, precision),
        "SIZES": "".join(f", {size} = {value}" for size, value in pieces.form.sizes.items()),
        "TABLES": "\n".join(table_text(table, precision) for table in tables),
        "GUARD": guard.code(rounded.reach),
        "BODY": pieces.form.body,
    }
    for part in _NESTED:
        words[part] = fill(words[part], words)
    words["SELFTEST"] = fill(SELFTEST, words)
    real = sum(table.size for table in tables if not table.whole)
    whole = sum(table.size for table in tables if table.whole)
    files = {f"{stem}.h": fill(HEADER, words), f"{stem}.c": fill(SOURCE, words)}
    return Exported(stem, files, real, real * precision.size + whole, pieces.operations, pieces.largest_rounding)


def tables_of(compensation: Compensation) -> tuple[Table, ...]:
    """All coefficients of a model, as the C code has them; `NotExported` for a model that has no C."""
    return _parts(compensation, DOUBLE)[1]


def _parts(compensation: Compensation, precision: Precision) -> tuple[Pieces, tuple[Table, ...]]:
    way = stream if isinstance(compensation.model, ThermalCycleModel) else rowwise
    pieces = way.pieces(compensation, precision)
    return pieces, (*guard.tables(compensation), *pieces.more, *pieces.form.tables)


def _words(compensation: Compensation, stem: str, precision: Precision) -> dict[str, str]:
    """What every header and source say."""
    document, output = compensation.document, compensation.output
    ranges = zip(compensation.inputs, compensation.reach.low, compensation.reach.high, strict=True)
    inputs = [
        f" *   x[{k}]  {one.name}, {one.unit}, {low:.6g} to {high:.6g}" for k, (one, low, high) in enumerate(ranges)
    ]
    meta = document["meta"]
    whose = f"gyro {meta['dut']}" if meta.get("dut") else "gyro not stated"
    return {
        "NAME": stem,
        "UPPER": stem.upper(),
        "REAL": precision.name,
        "SUFFIX": precision.suffix,
        "FACTOR": " / (real)3600" if output.unit == "deg/h" else "",
        "ABOUT": comment(f"{whose}, model {meta.get('model', document['kind'])}"),
        "KIND": comment(document["kind"]),
        "WRITTEN": comment(f"fogbench {document['versions'].get('fogbench', '')}".strip()),
        "ROWS": str(document["training"]["rows"]),
        "HASH": document["training"]["sha256"],
        "INPUTS": str(len(compensation.inputs)),
        "INPUT_LIST": comment("\n".join(inputs)),
        "OUTPUT": "the true rate" if output == RATE else "the bias error of the gyro",
        "UNIT": output.unit,
        "COMPENSATE_DECLARED": "" if output == RATE else COMPENSATE_DECLARED,
        "COMPENSATE": "" if output == RATE else COMPENSATE,
    }
