"""A finished run that tests of several files look at, or go on with in a copy of its folder."""

import pytest

import nlpgrasp as ng
from tests.experiments.small import experiment


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished") / "out"
    return ng.run_experiment(experiment(), folder, workers=2)
