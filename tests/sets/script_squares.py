"""Script of a set: two squares, with lines of progress; an argument is the folder."""

import sys

import nlpgrasp as ng
from tests.experiments.small import QUICK
from tests.sets.small import squares


def problems():
    return squares()


if __name__ == "__main__":
    settings = {"options": QUICK, "simulate": False, "starts": 16, "workers": 2}
    made = ng.make_set(problems(), 6, sys.argv[1], progress=lambda p: print(p, flush=True), **settings)
    sys.exit(not made.complete)
