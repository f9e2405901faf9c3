"""fogbench certificate: one page of one DUT, its figures, their uncertainty budgets, and what they are worth."""

from __future__ import annotations

from pathlib import Path

import click

from bench.cli.main import print_json
from bench.cli.options import json_option, results_option


@click.command("certificate")
@click.argument("run")
@click.option("--dut", help="Which DUT; may be left out if the run has one.")
@click.option("--model", help="Certify the rate compensated by this model of the run as well.")
@results_option
@json_option
def command(run: str, dut: str | None, model: str | None, results: Path, as_json: bool) -> None:
    """Write certificate-DUT.html, .pdf and .json into the folder of RUN.

    One page: unit, run, bench and conditions; the figures with expanded uncertainty for 95 %; the uncertainty budgets
    in the terms of the GUM; the outcome against the limits; hash of the raw data. A run on a virtual bench says on
    its certificate that it is a simulation.
    """
    from bench.certificate.write import write_certificate
    from bench.errors import UserMistake
    from bench.journal import load_journal
    from bench.runfolder import find_run

    folder = find_run(run, results)
    duts = list(load_journal(folder / "journal.jsonl")[0]["duts"])
    if dut is None and len(duts) > 1:
        raise UserMistake(
            f"{folder.name} has {len(duts)} DUTs; a certificate is of one: --dut {' or --dut '.join(duts)}"
        )
    written = write_certificate(folder, dut or duts[0], model)
    if as_json:
        print_json(written.document)
        return
    click.echo(f"{written.page.dut}: {written.page.outcome}, {written.page.outcome_words}")
    for path in written.files:
        click.echo(str(path))
