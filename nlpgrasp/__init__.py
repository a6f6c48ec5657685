"""Task-oriented optimal grasps by nonlinear programming, with certified bounds on their quality.

The public names are those that ``__init__.pyi`` imports. Each is imported where it is first asked for, so that
``import nlpgrasp`` takes hundredths of a second and a script loads what it uses.
"""

import ast
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType


def _modules() -> dict[str, str]:
    """Return the module of each public name, as the stub beside this file states it."""
    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = (node for node in stub.body if isinstance(node, ast.ImportFrom) and node.module)
    return {alias.name: str(node.module) for node in imports for alias in node.names}


_OF = _modules()
__all__ = sorted(_OF)


class _Package(ModuleType):
    """The package: public names appear in it when they are first asked for."""

    def __getattr__(self, name: str) -> object:
        if name not in _OF:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        inside = _OF[name]
        value = import_module(f"{inside}.{name}") if inside == self.__name__ else getattr(import_module(inside), name)
        self.__dict__[name] = value
        return value

    def __setattr__(self, name: str, value: object) -> None:
        """Take all but a sub-package that has a public name: ``nlpgrasp.solve`` stays the function."""
        if not (name in _OF and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __reduce__(self) -> tuple[object, tuple[str]]:
        """Be pickled by name, as modules are: functions that are sent to other processes refer to it."""
        return import_module, (self.__name__,)

    def __dir__(self) -> list[str]:
        return list(__all__)


sys.modules[__name__].__class__ = _Package
