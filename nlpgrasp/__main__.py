"""The command line as ``python -m nlpgrasp``."""

from nlpgrasp.cli.main import main

main()
