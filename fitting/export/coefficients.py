"""The coefficients of a model as one CSV table, for a spreadsheet or another program."""

import csv
import io

from fitting.export.c99 import tables_of
from fitting.modelfile import Compensation

HEADER = ("table", "row", "column", "unit", "value")


def coefficients_csv(compensation: Compensation) -> str:
    """One line a number: table, row from 0, column, unit, value with all its digits.

    The tables are those of the C code (`fitting.export`), which says how they are used. `NotExported` for a form that
    has none.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADER)
    for table in tables_of(compensation):
        for number, values in enumerate(table.values):
            for label, value in zip(table.columns, values.tolist(), strict=True):
                shown = int(value) if table.whole else value
                writer.writerow([table.name, number, label.name, label.unit, shown])
    return text.getvalue()
