"""fogbench compare"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bench.cli.options import json_option, results_option, table

if TYPE_CHECKING:
    from bench.compare.line import Line

SPLITS = {"random_train": "random, training", "random": "random, held back", "leave_temperatures_out": "left out"}


@click.command("compare")
@click.argument("runs", nargs=-1, required=True, metavar="RUN...")
@click.option("--models", help="Models by name, separated by commas; without it those of the run's procedure.")
@click.option("--seeds", default=10, show_default=True, type=click.IntRange(1, 1000), help="Splits drawn.")
@click.option(
    "-o", "--out", "out", type=click.Path(path_type=Path, file_okay=False), help="Folder for compare.csv and .svg."
)
@results_option
@json_option
def command(
    runs: tuple[str, ...], models: str | None, seeds: int, out: Path | None, results: Path, as_json: bool
) -> None:
    """Judge every model on the same points and the same splits of RUN... (run folders or run ids).

    Prints median and worst over the seeds beside the noise floor, and what each model costs; writes a table (CSV) and
    a figure (SVG) into the folder of the first run, or the one given.
    """
    from bench.compare.gather import compare
    from bench.compare.picture import draw
    from bench.runfolder import find_run, write_atomic

    folders = [find_run(run, results) for run in runs]
    names = [name.strip() for name in (models or "").split(",") if name.strip()]
    lines = compare(folders, names, seeds, lambda text: click.echo(f"{text} …", err=True))
    target = out or folders[0] / "compare"
    target.mkdir(parents=True, exist_ok=True)
    write_atomic(target / "compare.csv", _csv(lines).encode("utf-8"))
    draw(lines, target / "compare.svg")
    if as_json:
        click.echo(json.dumps([line.as_dict() for line in lines], indent=1))
        return
    click.echo(_text(lines))
    click.echo(f"\ntable: {target / 'compare.csv'}\nfigure: {target / 'compare.svg'}")


def _csv(lines: list[Line]) -> str:
    rows = [line.as_dict() for line in lines]
    text = [",".join(rows[0])]
    text += [",".join("" if value is None else str(value) for value in row.values()) for row in rows]
    return "\n".join(text) + "\n"


def _text(lines: list[Line]) -> str:
    """One block per DUT: a row per model, median and worst for each split."""
    blocks = []
    for owner in dict.fromkeys((line.run, line.dut) for line in lines):
        mine = [line for line in lines if (line.run, line.dut) == owner]
        splits = list(dict.fromkeys(line.split for line in mine))
        header = ["model"]
        for split in splits:
            header += [f"{SPLITS.get(split, split)}: std", "worst", "max|e|", "worst"]
        header += ["x floor", "fit, ms", "predict, us", "parameters", "guarded"]
        rows = [_row(model, mine, splits) for model in dict.fromkeys(line.model for line in mine)]
        seeds = len(mine[0].std_dps)
        title = (
            f"{owner[1]} of {owner[0]}, deg/s, median and worst of {seeds} seeds; noise floor {mine[0].floor_dps:.3g}"
        )
        blocks.append(f"{title}\n{table(rows, header)}")
    return "\n\n".join(blocks)


def _row(model: str, mine: list[Line], splits: list[str]) -> list[str]:
    found = {line.split: line.as_dict() for line in mine if line.model == model}
    row = [model]
    for split in splits:
        one = found.get(split, {})
        keys = ("std_median_dps", "std_worst_dps", "max_median_dps", "max_worst_dps")
        row += [_number(one.get(key)) for key in keys]
    last = found[splits[-1]] if splits[-1] in found else next(iter(found.values()))
    fit_s, predict_us, guarded = last["fit_s"], last["predict_us"], last["guarded"]
    row += [_number(last["times_floor"]), _number(None if fit_s is None else 1e3 * fit_s), _number(predict_us)]
    row += ["–" if last["parameters"] is None else str(last["parameters"])]
    return [*row, "–" if guarded is None else f"{100 * guarded:.0f} %"]


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"
