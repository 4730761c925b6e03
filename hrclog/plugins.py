"""Tables of things that users may add to: built-ins by dotted path, entry points of packages, `package.module:NAME`.

A table is light: what it names is imported when it is asked for. Entry points are read when a name is none of the
built-ins, or when all names are listed, for reading them takes time.
"""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from hrclog.errors import HrclogError

_NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")

T = TypeVar("T")


class PluginError(HrclogError):
    """Something that a user added cannot be taken, or is not there."""


class Registry(Mapping[str, T], Generic[T]):
    """The things of one kind, by name.

    Args:
        kind: what one of them is called in messages.
        group: of entry points through which packages add theirs; "" if they cannot.
        base: dotted path `module:NAME` of the class whose instances they are.
        builtins: dotted path of each built-in by its name; the first is the default.
    """

    def __init__(self, kind: str, group: str, base: str, builtins: Mapping[str, str]) -> None:
        self.kind = kind
        self.group = group
        self._base = base
        self._paths = dict(builtins)
        self._loaded: dict[str, T] = {}
        self._added: dict[str, str] = {}  # where each that is no built-in is found again

    @property
    def builtins(self) -> tuple[str, ...]:
        """Return the names of the built-ins, the default first."""
        return tuple(self._paths)

    @property
    def default(self) -> str:
        """Return the name of the default."""
        return next(iter(self._paths))

    def names(self) -> list[str]:
        """Return every name that is known: built-ins, then what was added here, then what packages add."""
        return list(dict.fromkeys([*self._paths, *self._loaded, *self._entry_points()]))

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __len__(self) -> int:
        return len(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self._paths or name in self._loaded or name in self._entry_points()

    def __getitem__(self, name: str) -> T:
        """Return the thing of a name, or of a dotted path `package.module:NAME`.

        Raises:
            PluginError: there is none, or it cannot be imported or is of another kind.
        """
        if not isinstance(name, str):
            raise PluginError(f"{self.kind} is {name!r}, expected the name of one, or package.module:NAME")
        if name not in self._loaded:
            self._load(name)
        return self._loaded[name]

    def register(self, thing: object) -> T:
        """Add an instance, or a class that can be made one without arguments, under its `name`.

        Raises:
            PluginError: it is of another kind, or its name is no name or is taken.
        """
        instance = self._make_instance(thing, _path(thing))
        name = self._name_of(instance, _path(thing))
        self._add_instance(name, instance, _path(thing))
        return instance

    def reference(self, name: str) -> str:
        """Return what finds a thing in another process: its name, or the dotted path of one that was added here."""
        return self._added.get(name, name)

    def _load(self, name: str) -> None:
        if name in self._paths:
            self._loaded[name] = self._make_instance(imported(self.kind, self._paths[name]), self._paths[name])
        elif ":" in name:
            _make_working_folder_importable()
            instance = self._make_instance(imported(self.kind, name), name)
            self._add_instance(self._name_of(instance, name), instance, name)
            self._loaded[name] = instance
        elif name in (points := self._entry_points()):
            self._loaded[name] = self._make_instance(imported(self.kind, points[name]), points[name])
        else:
            alternative = f", or package.module:NAME of {'an' if self.kind[0] in 'aeiou' else 'a'} {self.kind} of yours"
            raise PluginError(
                f"{self.kind} is {name!r}, expected one of {', '.join(self.names())}{alternative if self.group else ''}"
            )

    def _make_instance(self, thing: object, where: str) -> T:
        base: type[T] = imported(self.kind, self._base)
        try:
            instance = thing() if isinstance(thing, type) else thing
        except TypeError as error:
            raise PluginError(f"{self.kind} {where}: it cannot be made ({error}); expected a complete class") from error
        if not isinstance(instance, base):
            expected = f"expected {self._base.replace(':', '.')} or a subclass of it"
            raise PluginError(f"{self.kind} {where}: found {type(instance).__name__}, {expected}")
        return instance

    def _name_of(self, instance: T, where: str) -> str:
        name = getattr(instance, "name", None)
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            expected = "expected letters, digits, dots, hyphens and underscores"
            raise PluginError(f"{self.kind} {where}: its name is {name!r}, {expected}; give the class a name")
        return name

    def _add_instance(self, name: str, instance: T, where: str) -> None:
        holder = self._paths.get(name) or self._added.get(name) or self._entry_points().get(name, where)
        if holder != where:
            raise PluginError(f"{self.kind} {where}: the name {name!r} is taken by {holder}; choose another name")
        self._loaded[name], self._added[name] = instance, where

    def _entry_points(self) -> dict[str, str]:
        if not self.group:
            return {}
        return {point.name: point.value for point in entry_points(group=self.group)}


def _make_working_folder_importable() -> None:
    """Let `module:NAME` name a file in the working folder: an installed command does not look there by itself."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)


def _path(thing: object) -> str:
    kind = thing if isinstance(thing, type) else type(thing)
    return f"{kind.__module__}:{kind.__qualname__}"


def imported(kind: str, path: str) -> Any:  # noqa: ANN401 - whatever stands there
    """Return what a dotted path `module:NAME` names.

    Args:
        kind: what it is called in messages.
        path: of a module and a name in it, itself dotted if need be.

    Raises:
        PluginError: it cannot be imported.
    """
    module, _, name = path.partition(":")
    if module.endswith(".py"):
        module_name = module.removesuffix(".py").replace("/", ".")
        raise PluginError(f"{kind} {path!r} names a file; expected a module, {module_name}:{name}")
    try:
        value: Any = importlib.import_module(module)
    except (Exception, SystemExit) as error:
        reason = f"{type(error).__name__}: {error}"
        raise PluginError(
            f"{kind} {path!r} cannot be imported ({reason}); expected package.module:NAME, importable from here"
        ) from error
    for part in name.split("."):
        if not hasattr(value, part):
            raise PluginError(f"{kind} {path!r}: {module} has no {part!r}; expected package.module:NAME")
        value = getattr(value, part)
    return value
