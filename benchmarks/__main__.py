"""python3 do.py bench [NAME...]: all benchmarks, or those named (streams, fitting, cycles, campaign ...).

python3 do.py bench peers [OPTION...]: our models beside other packages; among all only if some are installed.
"""

import sys

from benchmarks import campaign, commands, cycles, fitting, peers, random_errors, streams

ALL = {
    "commands": commands.main,
    "streams": streams.main,
    "fitting": fitting.main,
    "cycles": cycles.main,
    "campaign": campaign.main,
    "random_errors": random_errors.main,
    "peers": peers.main,
}


def main() -> int:
    """Run the benchmarks named on the command line, or all."""
    if sys.argv[1:2] == ["peers"]:
        peers.main(sys.argv[2:])
        return 0
    names = sys.argv[1:] or [name for name in ALL if name != "peers" or peers.any_installed()]
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
