"""python3 do.py bench [NAME...]: all benchmarks, or those named (streams, fitting, cycles, campaign ...)."""

import sys

from benchmarks import campaign, commands, cycles, fitting, random_errors, streams

ALL = {
    "commands": commands.main,
    "streams": streams.main,
    "fitting": fitting.main,
    "cycles": cycles.main,
    "campaign": campaign.main,
    "random_errors": random_errors.main,
}


def main() -> int:
    """Run the benchmarks named on the command line, or all."""
    names = sys.argv[1:] or list(ALL)
    unknown = [name for name in names if name not in ALL]
    if unknown:
        print(f"unknown benchmark {unknown[0]}. Allowed: {', '.join(ALL)}", file=sys.stderr)
        return 2
    for name in names:
        print(f"\n== {name} ==", flush=True)
        ALL[name]()
    return 0


if __name__ == "__main__":
    sys.exit(main())
