"""The models of the exchange by name: which one proposes the steps of a problem's ascent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nlpgrasp.errors import InputError
from nlpgrasp.solve.ascent.ascend import Model, Rules
from nlpgrasp.solve.ascent.steps.linear import LinearModel
from nlpgrasp.solve.ascent.steps.nonlinear import NonlinearModel
from nlpgrasp.solve.workbench.workbench import Workbench


@dataclass(frozen=True)
class ExchangeModel:
    """A way to propose steps of the exchange.

    Parameters
    ----------
    name : str
        What ``SolveOptions.exchange`` calls it.
    make : callable
        ``make(bench)`` is the model for a problem.
    rules : Rules
        Trust region and thresholds that suit it; the options say how many rounds.
    suits : callable
        ``suits(bench)``: whether it serves a problem.
    """

    name: str
    make: Callable[[Workbench], Model]
    rules: Rules
    suits: Callable[[Workbench], bool]


_models: dict[str, ExchangeModel] = {}


def register(model: ExchangeModel) -> ExchangeModel:
    """Add a model; a later one of the same name takes the place of an earlier one."""
    _models[model.name] = model
    return model


def registered() -> tuple[ExchangeModel, ...]:
    """Return all models, in the order in which they were added."""
    return tuple(_models.values())


def check_name(exchange: bool | str) -> None:
    """Refuse a name that stands for no model.

    Raises
    ------
    InputError
        When nobody has registered the name.
    """
    if isinstance(exchange, str) and exchange not in _models:
        allowed = "True, False or one of " + ", ".join(map(repr, _models))
        raise InputError("SolveOptions.exchange", repr(exchange), allowed)


def model_of(bench: Workbench) -> ExchangeModel:
    """Return the model that the options name; where they name none, the first that suits the problem.

    Raises
    ------
    InputError
        When the model named is unknown or does not suit the problem.
    """
    wanted = bench.options.exchange
    if not isinstance(wanted, str):
        return next(model for model in registered() if model.suits(bench))
    check_name(wanted)
    if not _models[wanted].suits(bench):
        suitable = ", ".join(repr(model.name) for model in registered() if model.suits(bench))
        raise InputError("SolveOptions.exchange", repr(wanted), f"True, or a model that suits the problem: {suitable}")
    return _models[wanted]


LINEAR = Rules(rounds=40, radius=0.1, last_radius=1e-3, most_radius=0.3, good=1.6, poor=0.5, least_gain=1e-4)
NONLINEAR = Rules(rounds=40, radius=0.15, last_radius=1e-4, good=1.5, poor=0.6, least_gain=1e-4)
register(ExchangeModel("linear", LinearModel, LINEAR, lambda bench: bench.exchange.linearises))
register(
    ExchangeModel(
        "nonlinear", NonlinearModel, NONLINEAR, lambda bench: bench.exchange.closed or not bench.exchange.linearises
    )
)
OWN = registered()


def know_only(models: tuple[ExchangeModel, ...]) -> None:
    """Know the package's own models and these, whatever was registered before: what a worker's parent knows."""
    _models.clear()
    for model in (*OWN, *models):
        register(model)


def from_outside() -> tuple[ExchangeModel, ...]:
    """Return the models that are not the package's own: worker processes are told of them."""
    return tuple(model for model in registered() if model not in OWN)
