"""What installed packages offer by entry points: found without importing anything, imported when it is asked for.

A package that is broken is told of in a sentence where somebody asks for what it offers, and nowhere else.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from rig.errors import MesotapError


class PluginError(MesotapError, ValueError):
    """What a package or a file offers cannot be used; a sentence with its name."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was checked of a plug-in, whether it holds, and what was found."""

    name: str
    holds: bool
    said: str = ""


@dataclass(frozen=True, slots=True)
class Offered:
    """One entry point of an installed package.

    Attributes
    ----------
    name
        Under which it is offered.
    package
        Name and version of the package.
    entry
        The entry point itself, not yet imported.
    """

    name: str
    package: str
    entry: EntryPoint

    def where(self) -> str:
        """Return what it is called in sentences."""
        return f"entry point {self.name} ({self.entry.value}) of {self.package}"

    def loaded(self) -> Any:
        """Import it and return its value.

        Raises
        ------
        PluginError
            It cannot be imported.
        """
        try:
            return self.entry.load()
        except (Exception, SystemExit) as error:
            raise PluginError(
                f"{self.where()}: cannot be imported: {said_by(error)}; mend the package, or take it out with pip "
                "uninstall"
            ) from error


def offered(group: str) -> tuple[Offered, ...]:
    """Return what installed packages offer in a group, by name; the same package found twice counts once."""
    found: dict[tuple[str, str, str], Offered] = {}
    for entry in entry_points(group=group):
        package = "a package without a name" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"
        found.setdefault((entry.name, package, entry.value), Offered(entry.name, package, entry))
    return tuple(found[key] for key in sorted(found))


def one_of(candidates: Iterable[Offered], what: str) -> Offered | None:
    """Return the only candidate, None where there is none.

    Raises
    ------
    PluginError
        Several packages offer ``what``.
    """
    several = tuple(candidates)
    if len(several) > 1:
        names = " and ".join(candidate.package for candidate in several)
        raise PluginError(f"{what} is offered by {names}; take one of them out with pip uninstall")
    return several[0] if several else None


def module_of(file: Path, prefix: str) -> ModuleType:
    """Return a Python file as a module, kept under a name that begins with ``prefix``.

    Raises
    ------
    PluginError
        It is not a Python file, or cannot be imported.
    """
    name = f"{prefix}_{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise PluginError(f"{file}: is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # compiled laws are kept on disk by the name of their module
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise PluginError(f"{file}: cannot be imported: {said_by(error)}") from error
    return module


def said_by(error: BaseException) -> str:
    """Return an error of somebody else's code on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())
