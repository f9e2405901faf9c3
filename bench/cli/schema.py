"""fogbench schema"""

from __future__ import annotations

import click

from bench.cli.main import print_json


@click.command("schema")
@click.argument("kind", type=click.Choice(["procedure", "bench"]))
@click.option("--json", "as_json", is_flag=True, help="Accepted for symmetry; the output is JSON anyway.")
def command(kind: str, as_json: bool) -> None:
    """Print the JSON Schema of procedure or bench files, for completion in an editor."""
    from bench.schema import bench_schema, procedure_schema

    print_json(procedure_schema() if kind == "procedure" else bench_schema())
