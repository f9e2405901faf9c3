"""Entry point: finds a command by name and imports it only then, so that `fogbench --help` stays quick."""

from __future__ import annotations

import importlib
import json
import os
import signal
import sys
import traceback
from typing import Any

import click

from bench.errors import BenchFailure, ExitCode, FogbenchError, InvalidFiles

# name -> module, one line of help
COMMANDS = {
    "check": ("bench.cli.check", "Find every mistake in procedures and a bench file; touches no hardware."),
    "dry-run": ("bench.cli.dry_run", "Rehearse a procedure in virtual time: timeline, duration, what would go wrong."),
    "run": ("bench.cli.run", "Run a procedure on a bench, fit, report."),
    "status": ("bench.cli.status", "Say what a run is doing, from any terminal."),
    "pause": ("bench.cli.requests:pause", "Hold a run after its present step."),
    "continue": ("bench.cli.requests:go_on", "Let a paused run go on."),
    "abort": ("bench.cli.requests:abort", "End a run in order from another terminal."),
    "resume": ("bench.cli.resume", "Take a run up again after an abort, a failure, a crash or a power cut."),
    "compare": ("bench.cli.compare", "Judge many models on the same points and splits: one table, one figure."),
    "metrics": ("bench.cli.metrics", "Print the calibration figures of a run, each with uncertainty and definition."),
    "allan": ("bench.cli.allan", "Allan deviation, noise coefficients and plot, of a file or a run."),
    "certificate": ("bench.cli.certificate", "Write the calibration certificate of a DUT: one page, HTML and PDF."),
    "overview": ("bench.cli.overview", "Put the results of several runs on one page."),
    "simulate": (
        "bench.cli.simulate",
        "Put the instruments of a bench file on real ports, live: for other programs, and rehearsals.",
    ),
    "fit": ("bench.cli.fit", "Fit models to an old run again, or to your own data."),
    "compensate": ("bench.cli.compensate", "Compensate the rates of a file with a model."),
    "export": ("bench.cli.export", "Write models as C, CSV or JSON, for other programs."),
    "report": ("bench.cli.report", "Write report.html of a run again."),
    "verify": ("bench.cli.verify", "Compute a run's points and models again; say what does not match."),
    "list": ("bench.cli.list", "List the runs in the results folder."),
    "schema": ("bench.cli.schema", "Print the JSON Schema of procedure or bench files."),
}

EPILOG = """\b
Exit codes:
  0    done, everything passed
  1    done, but a measured limit failed (or could not be measured)
  2    a mistake in the command, procedure or bench file; nothing was touched
  3    the bench failed: an instrument, a port, the host
  130  interrupted; the bench was brought to its safe state
"""


class LazyGroup(click.Group):
    """Commands imported on use; their one-line help stands here so that listing them imports nothing."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module, _, name = COMMANDS[cmd_name][0].partition(":")
        return getattr(importlib.import_module(module), name or "command")  # type: ignore[no-any-return]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.command(cls=LazyGroup, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="fogbench")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """fogbench runs gyro calibration campaigns from a YAML procedure, on real instruments or on a virtual bench."""
    ctx.color = _colour_wanted()


def _colour_wanted() -> bool | None:
    """No colour if NO_COLOR is set (no-color.org) or the terminal is dumb; else only on a terminal."""
    return False if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb" else None


def main() -> None:
    """Run the command line; errors become one paragraph and an exit code."""
    try:
        code = cli.main(standalone_mode=False)
    except click.ClickException as error:
        error.show()
        code = ExitCode.USER_MISTAKE
    except (click.Abort, KeyboardInterrupt):
        _deaf_to_interrupts()
        click.echo("interrupted", err=True)
        code = ExitCode.INTERRUPTED
    except FogbenchError as error:
        _deaf_to_interrupts()
        show_error(error)
        code = error.exit_code
    except BrokenPipeError:
        sys.stderr.close()
        code = ExitCode.PASSED
    except OSError as error:
        show_error(BenchFailure(f"{error}. Is the disk full or a folder not writable? What was journaled is kept."))
        code = ExitCode.BENCH_FAILED
    except Exception as error:
        # A defect of ours must not look like exit code 1, "a measured limit failed".
        traceback.print_exc()
        show_error(BenchFailure(f"fogbench itself failed ({type(error).__name__}); the lines above say where."))
        code = ExitCode.BENCH_FAILED
    _deaf_to_interrupts()
    sys.exit(int(code or 0))


def _deaf_to_interrupts() -> None:
    """One Ctrl-C more must not change the exit code of a process that is on its way out."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def show_error(error: FogbenchError) -> None:
    """Print an error: as JSON if --json was given, else as text on stderr."""
    if "--json" in sys.argv:
        problems = error.problems if isinstance(error, InvalidFiles) else []
        listed = [
            {"file": p.mark.file, "line": p.mark.line, "column": p.mark.column, "message": p.message} for p in problems
        ]
        click.echo(
            json.dumps(
                {"error": str(error), "exit_code": int(error.exit_code), "problems": listed},
                indent=1,
                ensure_ascii=False,
            )
        )
    else:
        click.echo(click.style("error: ", fg="red", bold=True) + str(error), err=True, color=_colour_wanted())


def print_json(value: Any) -> None:
    """Print a result as JSON."""
    click.echo(json.dumps(value, indent=1, ensure_ascii=False, default=str))
