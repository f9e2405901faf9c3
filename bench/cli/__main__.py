"""python -m bench.cli is fogbench."""

from bench.cli.main import main

main()
