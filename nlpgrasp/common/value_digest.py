"""Digests of Python values by content, functions included: equal in two processes only where the values behave alike.

A function counts with its bytecode, constants, defaults, captured values, and the globals and module attributes that it
names, recursively. Functions and classes of ``COMPARABLE_MODULES`` count by name and version. What a digest cannot
state, such as files that are read, random numbers, the clock or other installed packages, raises
``IncomparableError``: such values are never taken for equal.
"""

from __future__ import annotations

import builtins
import dis
import functools
import hashlib
import struct
import sys
import sysconfig
import types
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from nlpgrasp.common.types import Expression
from nlpgrasp.errors import NlpgraspError

PACKAGE = "nlpgrasp"
UNIQUE = "once-"  # prefix of what stands for the digest of a function that cannot be compared
INSTALLED_FOLDERS = ("site-packages", "dist-packages")
COMPARABLE_MODULES = frozenset(
    {
        *("abc", "array", "base64", "bisect", "builtins", "cmath", "collections", "collections_abc", "contextlib"),
        *("copy", "copyreg", "dataclasses", "datetime", "decimal", "enum", "fractions", "functools", "hashlib"),
        *("heapq", "itertools", "json", "math", "numbers", "operator", "re", "sre", "statistics", "string", "struct"),
        *("textwrap", "thread", "types", "typing", "warnings", "zlib", "casadi", PACKAGE, "numpy", "scipy", "trimesh"),
    }
)
"""Installed modules whose functions depend on their arguments and the version alone, but for the names below."""
OUTSIDE_BUILTINS = {"__import__", "compile", "eval", "exec", "globals", "input", "locals", "open"}
OUTSIDE_NAMES = {
    *("DataSource", "Importer", "TaskLibrary", "default_rng", "environ", "external", "fromfile", "genfromtxt"),
    *("imread", "memmap", "mmread", "now", "rand", "random", "rvs", "today", "utcnow"),
}
OUTSIDE_PREFIXES = ("load", "open", "read")
"""Names of functions of these modules, and their beginnings, that depend on more than their arguments."""
ANY_OBJECT = frozenset({"open", "read_bytes", "read_text", "rvs"})  # of any object
CLASS_ENTRIES_LEFT_OUT = frozenset(
    [
        "__abstractmethods__",
        "__annotate__",
        "__annotate_func__",
        "__annotations__",
        "__annotations_cache__",
        "__dataclass_fields__",
        "__dataclass_params__",
        "__dict__",
        "__doc__",
        "__firstlineno__",
        "__match_args__",
        "__module__",
        "__orig_bases__",
        "__parameters__",
        "__qualname__",
        "__slotnames__",
        "__static_attributes__",
        "__weakref__",
        "_abc_impl",
    ]
)
HEAP_TYPE = 1 << 9  # flag of classes that are made at run time
GENERATED = "<string>"  # file of the methods that ``dataclass`` writes
NAMED_TYPES = (types.BuiltinFunctionType, types.MethodDescriptorType, types.WrapperDescriptorType)
PLAIN = frozenset({"abc", "collections.abc", "enum", "typing"})  # modules of base classes without state
ARRAY_KINDS = "biufcSUVmM"  # of dtypes whose bytes are their content


class IncomparableError(NlpgraspError):
    """Error raised for a value that cannot be compared with one of another process.

    Its text is the reason.
    """


def value_digest(value: object) -> str:
    """Return the SHA-256 of a value's content, hexadecimal.

    Raises
    ------
    IncomparableError
        When the value depends on what is not part of it, or holds what cannot be read.
    """
    digest = _ValueDigest()
    try:
        digest.add(value)
    except RecursionError:
        raise IncomparableError("it is nested too deeply") from None
    return digest.hexdigest()


def is_installed(module_name: str) -> bool:
    """Return whether a module is built in, of the standard library, or of an installed package."""
    top = module_name.partition(".")[0]
    if top == PACKAGE or module_name in sys.builtin_module_names:
        return True
    if top == "__main__":
        return False
    file = getattr(sys.modules.get(module_name) or sys.modules.get(top), "__file__", None)
    if file is None:
        spec = getattr(sys.modules.get(top), "__spec__", None)
        return getattr(spec, "origin", None) in ("built-in", "frozen")
    folders = file.replace("\\", "/").split("/")
    library = (sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib"))
    return any(name in folders for name in INSTALLED_FOLDERS) or file.startswith(library)


class _ValueDigest:
    """Digest of values in the order in which they are added."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self._known: dict[object, int] = {}  # number of each visited object, by its id
        self._kept: list[object] = []  # visited objects, whose ids no other object may take

    def hexdigest(self) -> str:
        return self._hash.hexdigest()

    def _write(self, tag: str, content: bytes | str = b"") -> None:
        data = content.encode("utf-8", "surrogatepass") if isinstance(content, str) else content
        self._hash.update(f"{tag}:{len(data)}:".encode())
        self._hash.update(data)

    def _is_known(self, key: object, value: object) -> bool:
        """Write the number of a value that was visited before; else number it and return false."""
        number = self._known.setdefault(key, len(self._known))
        if number < len(self._kept):
            self._write("known", str(number))
            return True
        self._kept.append(value)
        return False

    def add(self, value: Any) -> None:
        """Add a value's content."""
        kind = type(value)
        if value is None or value is Ellipsis or value is NotImplemented or kind in (bool, int):
            self._write("constant", repr(value))
        elif kind is float:
            self._write("float", struct.pack("<d", value))
        elif kind is complex:
            self._write("complex", struct.pack("<dd", value.real, value.imag))
        elif kind is str:
            self._write("text", value)
        elif kind in (bytes, bytearray):
            self._write("bytes", bytes(value))
        elif kind is tuple:
            self._items("tuple", value)
        elif kind is frozenset:
            self._write("frozenset", "".join(sorted(map(value_digest, value))))
        elif kind is np.ndarray:
            self._array(value)
        elif isinstance(value, np.dtype):
            self._write("dtype", str(value.descr if value.fields else value.str))
        elif isinstance(value, np.generic) and value.dtype.kind in ARRAY_KINDS:
            self._array(np.asarray(value))
        elif kind is types.CodeType:
            self._code(value)
        elif kind is types.ModuleType:
            self._module(value, frozenset())
        elif kind in NAMED_TYPES or kind is np.ufunc:
            self._named(value)
        elif not self._is_known(id(value), value):
            self._reference(value)

    def _items(self, tag: str, values: Any) -> None:
        self._write(tag, str(len(values)))
        for item in values:
            self.add(item)

    def _array(self, array: np.ndarray[Any, Any]) -> None:
        self._write("array", f"{array.dtype.str} {array.shape}")
        if array.dtype.kind == "O":
            self._items("objects", array.ravel().tolist())
        elif array.dtype.kind in ARRAY_KINDS:
            self._write("content", np.ascontiguousarray(array).tobytes())
        else:
            raise IncomparableError(f"it holds an array of type {array.dtype}")

    def _reference(self, value: Any) -> None:
        """Add the content of an object that others may refer to."""
        kind = type(value)
        if kind is list:
            self._items("list", value)
        elif kind in (dict, types.MappingProxyType):
            self._items("mapping", list(value.items()))
        elif kind is set:
            self._write("set", "".join(sorted(map(value_digest, value))))
        elif kind is types.FunctionType:
            self._function(value)
        elif kind is types.MethodType:
            self._items("method", (value.__func__, value.__self__))
        elif kind in (staticmethod, classmethod):
            self._items(kind.__name__, (value.__func__,))
        elif kind is property:
            self._items("property", (value.fget, value.fset, value.fdel))
        elif kind is functools.cached_property:
            self._items("cached_property", (value.func,))
        elif kind is functools._lru_cache_wrapper:
            self._items("cache", (value.__wrapped__,))
        elif kind in (types.GetSetDescriptorType, types.MemberDescriptorType):
            self._write("slot", value.__name__)
        elif isinstance(value, type):
            self._class(value)
        elif kind.__module__.partition(".")[0] == "casadi":
            self._casadi(value)
        elif callable(value) and self._is_named(value):
            self._named(value)
        else:
            self._instance(value)

    # Functions

    def _function(self, function: types.FunctionType) -> None:
        if self._is_named(function):
            self._named(function)
            return
        code, names = function.__code__, frozenset(_names(function.__code__))
        self._code(code)
        self._items("defaults", (function.__defaults__, function.__kwdefaults__, function.__dict__))
        for cell in function.__closure__ or ():
            try:
                self._referred(cell.cell_contents, names)
            except ValueError:
                self._write("empty")
        for name, is_import in sorted(set(_globals(code))):
            self._write("import" if is_import else "global", name)
            if is_import:
                if name not in sys.modules:
                    raise IncomparableError(f"it imports {name or 'a neighbour of its module'}")
                self._referred(sys.modules[name], names)
            elif name in function.__globals__:
                self._referred(function.__globals__[name], names)
            elif name in OUTSIDE_BUILTINS:
                raise IncomparableError(f"it calls {name}")
            else:
                self._write("builtin", str(hasattr(builtins, name)))
        if outside := sorted(ANY_OBJECT & names):
            raise IncomparableError(f"it uses {outside[0]}")

    def _referred(self, value: Any, names: frozenset[str]) -> None:
        """Add a value that a function with some names of attributes refers to."""
        if type(value) is types.ModuleType:
            self._module(value, names)
            return
        is_class = isinstance(value, type) and is_installed(value.__module__)
        if is_class and (outside := next(_outside_names(value, names), None)):
            raise IncomparableError(f"it uses {value.__name__}.{outside}")
        self.add(value)

    def _code(self, code: types.CodeType) -> None:
        counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
        self._items("code", (counts, code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars))
        self._write("exceptions", getattr(code, "co_exceptiontable", b""))
        self._items("constants", code.co_consts)

    def _module(self, module: types.ModuleType, names: frozenset[str]) -> None:
        """Add a module, of a user's own one the attributes with the given names."""
        name = module.__name__
        if is_installed(name):
            if outside := next(_outside_names(module, names), None):
                raise IncomparableError(f"it uses {name}.{outside}")
            self._check_module(name)
            self._installed(name, "")
            return
        if not names or "__dict__" in names or {"getattr", "vars"} & names:
            raise IncomparableError(f"it refers to the module {name} as a whole")
        if self._is_known((id(module), names), module):
            return
        self._write("module", name)
        for attribute in sorted(names & set(vars(module))):
            self._write("attribute", attribute)
            self._referred(vars(module)[attribute], names)

    @staticmethod
    def _check_module(name: str) -> None:
        """Raise for modules whose functions may depend on more than their arguments."""
        top = name.partition(".")[0].lstrip("_")
        if top not in COMPARABLE_MODULES or name.startswith(("numpy.random", "scipy.datasets", "scipy.io")):
            raise IncomparableError(f"it uses the module {name}")

    @staticmethod
    def _is_named(value: Any) -> bool:
        """Return whether a function or class is the one of its name in an installed module."""
        module_name = getattr(value, "__module__", None)
        if not isinstance(module_name, str) or not is_installed(module_name):
            return False
        found: Any = sys.modules.get(module_name)
        for name in str(getattr(value, "__qualname__", getattr(value, "__name__", ""))).split("."):
            found = getattr(found, name, None)
        return found is value

    def _named(self, value: Any) -> None:
        """Add a function of an installed module, or a method of a built-in object, by its name."""
        owner = getattr(value, "__self__", None)
        if owner is not None and not isinstance(owner, types.ModuleType):
            self._items("bound", (value.__name__, owner))
            return
        home = getattr(value, "__objclass__", None) or owner
        module_name = getattr(value, "__module__", None) or getattr(home, "__module__", "") or "numpy"
        name = getattr(value, "__qualname__", value.__name__)
        if not is_installed(module_name):
            raise IncomparableError(f"it calls {module_name}.{name}, which is compiled")
        if _is_outside(value.__name__) or (module_name == "builtins" and name in OUTSIDE_BUILTINS):
            raise IncomparableError(f"it calls {module_name}.{name}")
        self._check_module(module_name)
        self._installed(module_name, name)

    def _installed(self, module_name: str, name: str) -> None:
        version = getattr(sys.modules.get(module_name.partition(".")[0]), "__version__", "")
        self._write("installed", f"{module_name}.{name} {version}")

    # Classes and their instances

    def _class(self, cls: type) -> None:
        is_built_in = cls.__module__ == "builtins" and not cls.__flags__ & HEAP_TYPE  # classes of ``exec`` say so too
        if is_built_in or self._is_named(cls):
            self._check_module(cls.__module__)
            self._installed(cls.__module__, cls.__qualname__)
            return
        self._write("class", cls.__qualname__)
        self._items("bases", (type(cls), *cls.__bases__))
        for name, entry in sorted(vars(cls).items()):
            code = getattr(entry, "__code__", None)
            if name not in CLASS_ENTRIES_LEFT_OUT and (code is None or code.co_filename != GENERATED):
                self._write("entry", name)
                self.add(entry)

    def _instance(self, value: Any) -> None:
        cls = type(value)
        if cls.__module__.startswith(("numpy.random", "random", "_random")):
            raise IncomparableError("it draws random numbers")
        self.add(cls)
        if cls.__module__.startswith("trimesh") and hasattr(value, "faces"):  # beside them it keeps what was computed
            self._items("mesh", (np.asarray(value.vertices, dtype=float), np.asarray(value.faces)))
            return
        state = dict(state_of(value))
        self._items("state", [(name, state[name]) for name in sorted(state)])
        modules = {base.__module__ for base in cls.__mro__ if base is not object}
        if any(is_installed(name) and name not in PLAIN and not name.startswith(PACKAGE) for name in modules):
            self._reduced(value, cls)

    def _reduced(self, value: Any, cls: type) -> None:
        """Add an object with state in C as ``pickle`` takes it apart."""
        try:
            parts = value.__reduce_ex__(4)
        except Exception:  # any error of the object's own
            raise IncomparableError(f"it holds an object of type {cls.__name__}") from None
        if isinstance(parts, str):
            self._named(value)
            return
        function, arguments, state, items, pairs = (*parts, None, None, None)[:5]
        if isinstance(state, Mapping):
            state = {name: entry for name, entry in state.items() if name not in _cached_names(cls)}
        self._items("reduced", (function, arguments, state, list(items or ()), list(pairs or ())))

    def _casadi(self, value: Any) -> None:
        """Add a CasADi object by its serialisation."""
        import casadi as ca

        self.add(type(value))
        try:
            symbols = [] if isinstance(value, ca.DM | ca.Function) else ca.symvar(value)
            function = value if isinstance(value, ca.Function) else ca.Function("v", symbols, [value])
            self._write("casadi", function.serialize())
        except Exception:  # whatever CasADi raises
            raise IncomparableError(f"it holds a CasADi object of type {type(value).__name__}") from None


def state_of(value: object) -> Iterator[tuple[str, object]]:
    """Yield the attributes of an instance, without what cached properties keep."""
    cached = _cached_names(type(value))
    for name, entry in getattr(value, "__dict__", {}).items():
        if name not in cached:
            yield name, entry
    for cls in type(value).__mro__:
        slots = vars(cls).get("__slots__", ())
        for name in (slots,) if isinstance(slots, str) else slots:
            attribute = f"_{cls.__name__.lstrip('_')}{name}" if name[:2] == "__" != name[-2:] else name
            if attribute not in ("__dict__", "__weakref__") and hasattr(value, attribute):
                yield attribute, getattr(value, attribute)


def _cached_names(cls: type) -> set[str]:
    """Return the names of a class's cached properties."""
    entries = (entry for c in cls.__mro__ for entry in vars(c).items())
    return {name for name, entry in entries if isinstance(entry, functools.cached_property)}


def _is_outside(name: str) -> bool:
    """Return whether a function of an installed package with a name may depend on more than its arguments."""
    return name in OUTSIDE_NAMES or name.startswith(OUTSIDE_PREFIXES)


def _outside_names(owner: object, names: frozenset[str], depth: int = 4) -> Iterator[str]:
    """Yield those of some names of attributes that ``_is_outside`` names, of a module or class and of those in it."""
    for name in sorted(names & set(dir(owner))):
        if _is_outside(name):
            yield name
        entry = getattr(owner, name, None)
        if isinstance(entry, types.ModuleType | type) and depth:
            yield from _outside_names(entry, names, depth - 1)


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """Yield a code object and all code objects inside it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _names(code: types.CodeType) -> Iterator[str]:
    """Yield the names of globals and attributes that code uses."""
    for inner in _codes(code):
        yield from inner.co_names


def _globals(code: types.CodeType) -> Iterator[tuple[str, bool]]:
    """Yield the names of globals that code reads, and of modules that it imports, with whether it is an import."""
    for inner in _codes(code):
        for instruction in dis.get_instructions(inner):
            if instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
                yield str(instruction.argval), False
            elif instruction.opname == "IMPORT_NAME":
                yield str(instruction.argval), True


def function_digest(function: object) -> str:
    """Return the digest of a function, or where it cannot be compared a text that no other function has."""
    try:
        return value_digest(function)
    except IncomparableError:
        return unique_digest()


def expression_digest(expression: Callable[..., Expression], arguments: Sequence[Expression]) -> str:
    """Return the SHA-256 of the CasADi function that an expression of symbols is; one that varies has no equal."""
    import casadi as ca

    first, second = (ca.Function("f", list(arguments), [expression(*arguments)]).serialize() for _ in range(2))
    return hashlib.sha256(first.encode()).hexdigest() if first == second else unique_digest()


def is_comparable(digest: str) -> bool:
    """Return whether a digest of a function can be that of another process's function."""
    return not digest.startswith(UNIQUE)


def unique_digest() -> str:
    """Return what stands for the digest of a function that cannot be compared."""
    return f"{UNIQUE}{uuid.uuid4().hex}"
