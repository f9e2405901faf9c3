"""fogbench simulate"""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.cli.options import existing_file, json_option, seed_option

if TYPE_CHECKING:
    from bench.benchfile import Bench
    from bench.composition import LiveOptions


@click.command("simulate")
@click.argument("bench_path", metavar="BENCH", type=existing_file)
@click.option(
    "--speed",
    default=1.0,
    show_default=True,
    type=click.FloatRange(min=0.0, min_open=True),
    help="Bench seconds per second of the wall.",
)
@seed_option
@click.option("--tcp", is_flag=True, help="TCP ports of this machine instead of ptys.")
@click.option(
    "--can",
    metavar="INTERFACE:CHANNEL",
    help="Send the frames of CAN gyros on this python-can bus, like socketcan:vcan0, instead of by serial adapters.",
)
@click.option(
    "--links",
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    help="Name the ptys by links in this folder, the same after every start.",
)
@click.option(
    "--truth",
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    help="Write there what the simulators hide: truth.json, truth.csv.",
)
@click.option("--truth-every", default="10 s", show_default=True, metavar="TIME", help="Bench time from row to row.")
@click.option(
    "-o", "--output", metavar="FILE", type=click.Path(path_type=Path), help="Write the bench file to connect with."
)
@json_option
def command(
    bench_path: Path,
    speed: float,
    seed: int | None,
    tcp: bool,
    can: str | None,
    links: Path | None,
    truth: Path | None,
    truth_every: str,
    output: Path | None,
    as_json: bool,
) -> None:
    """Put the instruments of BENCH on ptys, TCP ports and CAN buses, live, until Ctrl-C or SIGTERM.

    Prints the bench file to connect with. Runs come and go; the instruments stay as they were left: a table that turns
    goes on turning. With --json one line is printed.
    """
    from bench.composition import open_live, seed_of
    from bench.livefile import live_file

    bench = _load(bench_path)
    options = _options(speed, tcp, can, links)
    period_s = _period_s(truth_every)
    seeded = seed_of(bench) if seed is None else seed
    with open_live(bench, seeded, options, truth, period_s, _tell) as (live, ports):
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), lambda number, frame: live.stop())
        text = live_file(bench, ports, speed)
        if output:
            _write(output, text)
        if as_json:
            _print_line(bench_path, output, text, {".".join(map(str, path)): port for path, port in ports.items()})
        else:
            _show(bench, output, text)
        live.serve()


def _load(path: Path) -> Bench:
    from bench.benchfile import load_bench
    from bench.errors import InvalidFiles

    bench, problems = load_bench(path)
    if bench is None:
        raise InvalidFiles(problems)
    return bench


def _options(speed: float, tcp: bool, can: str | None, links: Path | None) -> LiveOptions:
    from bench.composition import LiveOptions
    from bench.errors import UserMistake

    interface, _, channel = (can or "").partition(":")
    if can is not None and not (interface and channel):
        raise UserMistake(f"--can {can}: an interface and a channel are expected, like socketcan:vcan0.")
    try:
        return LiveOptions(speed, tcp, (interface, channel) if can else None, links and links.absolute())
    except ValueError as error:
        raise UserMistake(f"{error}.") from error


def _period_s(text: str) -> float:
    from bench.errors import UserMistake
    from bench.units import parse_quantity

    try:
        period_s = parse_quantity(text, "s")
    except ValueError as error:
        raise UserMistake(f"--truth-every {text}: {error}") from error
    if period_s <= 0:
        raise UserMistake(f"--truth-every {text}: a time above 0 is expected, like 10 s.")
    return period_s


def _write(path: Path, text: str) -> None:
    """Write the file at once: who waits for it never sees a part."""
    from bench.runfolder import write_atomic

    write_atomic(path, text.encode("utf-8"))


def _print_line(bench: Path, output: Path | None, text: str, ports: dict[str, Any]) -> None:
    written = str(output) if output else None
    click.echo(json.dumps({"simulated": str(bench), "bench": written, "ports": ports, "bench_file": text}))


def _show(bench: Bench, output: Path | None, text: str) -> None:
    if output is None:
        click.echo(text, nl=False)
    click.echo(
        f"{bench.file.bench} is live with {len(list(bench.instruments))} instruments. Connect with: fogbench run "
        f"PROCEDURE --bench {output or 'FILE'}{'' if output else ', where FILE holds the above'}. Ctrl-C ends it.",
        err=True,
    )


def _tell(text: str) -> None:
    click.echo(f"warning: {text}", err=True)
