"""Benchmarks are importable, which only ``python -m benchmarks`` would show otherwise."""

import importlib
import pkgutil

import pytest

import benchmarks

MODULES = [m.name for m in pkgutil.walk_packages(benchmarks.__path__, "benchmarks.") if not m.name.endswith("__main__")]


@pytest.mark.parametrize("name", MODULES)
def test_a_benchmark_is_importable(name):
    assert importlib.import_module(name).__doc__
