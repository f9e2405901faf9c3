"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

existing_file = click.Path(path_type=Path)

bench_option = click.option("--bench", "bench_path", required=True, type=existing_file, help="The bench file (YAML).")
results_option = click.option(
    "--results", default="results", show_default=True, type=click.Path(path_type=Path), help="Where runs are kept."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
seed_option = click.option("--seed", type=click.IntRange(min=0), help="Seed of the simulation instead of the bench's.")
junit_option = click.option(
    "--junit", type=click.Path(path_type=Path, dir_okay=False), help="Write the result as JUnit XML, for CI systems."
)
set_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="PATH=VALUE",
    help="Change one value, e.g. --set bench.simulation.seed=7 or --set procedure.raw=none.",
)


def table(rows: list[list[Any]], header: list[str]) -> str:
    """Plain text table; numbers are right-aligned.

    >>> print(table([["a", 1], ["bb", 22]], ["name", "n"]))
    name   n
    a      1
    bb    22
    """
    cells = [header, *([str(cell) for cell in row] for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    numeric = [
        all(isinstance(row[i], int | float) or str(row[i])[:1] in "0123456789-–" for row in rows)
        for i in range(len(header))
    ]
    lines = []
    for row in cells:
        parts = [c.rjust(w) if n else c.ljust(w) for c, w, n in zip(row, widths, numeric, strict=True)]
        lines.append("  ".join(parts).rstrip())
    return "\n".join(lines)
