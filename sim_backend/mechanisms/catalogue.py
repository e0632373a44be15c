"""All mechanisms by id: those of this package, of a user's folders, and of installed packages."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from rig.plugins import Offered, PluginError, module_of, offered, one_of
from sim_backend.arrangement import Arrangement
from sim_backend.mechanisms.kinds import ForceLaw, Mechanism
from sim_backend.mechanisms.places import Place

GROUP = "mesotap.mechanisms"
"""Entry points of installed packages that hold a mechanism."""
PARTS = ("catalogue", "conformance", "kinds", "places")
"""Modules of this package that are no mechanisms."""


class MechanismError(PluginError):
    """A file holds no mechanism that can be used; a sentence with its name."""


def catalogue(folders: Sequence[str | Path] = ()) -> dict[str, tuple[Mechanism, ...]]:
    """Return the variants of every mechanism by id, in the order of their ids within each source.

    Parameters
    ----------
    folders
        Folders of a user's own mechanisms, a Python file each; files whose names begin with ``_`` are left out.

    Raises
    ------
    PluginError
        A folder or file cannot be read, holds no mechanism, or one whose id exists already; of an installed package
        see `left_out`.
    """
    return dict(_catalogue(_places(folders))[0])


def left_out(folders: Sequence[str | Path] = ()) -> tuple[str, ...]:
    """Return in sentences which mechanisms of installed packages cannot be used and are not in the catalogue."""
    return _catalogue(_places(folders))[1]


def _places(folders: Sequence[str | Path]) -> tuple[str, ...]:
    return tuple(str(Path(folder).absolute()) for folder in folders)


def family(mechanism_id: str, folders: Sequence[str | Path] = ()) -> tuple[Mechanism, ...] | None:
    """Return the variants of one mechanism, None where there is none; installed packages are asked last.

    Raises
    ------
    PluginError
        As `catalogue`; a package that is broken matters only where nothing else has this id.
    """
    places = _places(folders)
    found = _own(places).get(mechanism_id)
    if found is not None:
        return found
    known, faults = _catalogue(places)
    if mechanism_id not in known and faults:
        raise MechanismError(faults[0])
    return known.get(mechanism_id)


def variants(known: Mapping[str, tuple[Mechanism, ...]]) -> list[Mechanism]:
    """Return all variants of all mechanisms."""
    return [m for family in known.values() for m in family]


def placed(known: Iterable[Mechanism], rig: Arrangement) -> list[tuple[Mechanism, Place]]:
    """Return every mechanism with every place in a rig.

    Of a family that has places in the component it is named for, only these are returned.
    """
    every = [(m, place) for m in known for place in m.places(rig)]
    at_home = {m.id for m, place in every if component(m, rig, place) == m.component}
    return [(m, place) for m, place in every if m.id not in at_home or component(m, rig, place) == m.component]


def component(mechanism: Mechanism, rig: Arrangement, place: Place) -> str:
    """Return the component of the contract that a mechanism in a place belongs to."""
    return rig.elements[place[0]].component if isinstance(mechanism, ForceLaw) else mechanism.component


@cache
def _catalogue(folders: tuple[str, ...]) -> tuple[dict[str, tuple[Mechanism, ...]], tuple[str, ...]]:
    """Return all mechanisms, and what is wrong with those of installed packages that are left out."""
    found, faults = dict(_own(folders)), []
    for entry in offered(GROUP):
        try:
            _add(found, family_of(entry.loaded(), entry.where()), entry.where())
        except PluginError as error:
            faults.append(str(error))
    return found, tuple(faults)


@cache
def _own(folders: tuple[str, ...]) -> dict[str, tuple[Mechanism, ...]]:
    """Return the mechanisms of this package and of a user's folders."""
    import sim_backend.mechanisms as package

    found: dict[str, tuple[Mechanism, ...]] = {}
    for module in sorted(m.name for m in pkgutil.iter_modules(package.__path__)):
        if module not in PARTS:
            _add(found, family_of(importlib.import_module(f"{package.__name__}.{module}"), module), module)
    for folder in folders:
        path = Path(folder)
        if not path.is_dir():
            raise MechanismError(f"{path}: is not a folder of mechanisms; analysis.mechanisms names it")
        for file in sorted(path.glob("[!_]*.py")):
            _add(found, load_file(file), str(file))
    return found


def load_installed(name: str) -> tuple[Mechanism, ...]:
    """Return the variants that an installed package offers, by the name of the entry point or by their id.

    Raises
    ------
    PluginError
        No package does, several do, or what it offers is no mechanism.
    """
    entry = one_of((o for o in offered(GROUP) if o.name == name), f"the mechanism {name}")
    entry = entry or one_of((o for o in offered(GROUP) if _id_of(o) == name), f"the mechanism {name}")
    if entry is None:
        raise MechanismError(f"{name}: is neither a Python file nor a mechanism that an installed package offers")
    return family_of(entry.loaded(), entry.where())


def _id_of(entry: Offered) -> str | None:
    """Return the id of what an installed package offers; None if it cannot be used."""
    try:
        return family_of(entry.loaded(), entry.where())[0].id
    except PluginError:
        return None


def load_file(file: Path) -> tuple[Mechanism, ...]:
    """Return the variants in a Python file.

    Raises
    ------
    PluginError
        It cannot be imported or holds no mechanism.
    """
    import sim_backend.mechanisms as package

    if file.resolve().parent in (Path(place).resolve() for place in package.__path__):
        # under a second name, the law compiled here would be kept on disk for a module that no other process has
        return family_of(importlib.import_module(f"{package.__name__}.{file.stem}"), str(file))
    return family_of(module_of(file, "mesotap_mechanism"), str(file))


def family_of(loaded: Any, where: str) -> tuple[Mechanism, ...]:
    """Return the variants that a module, or an entry point's value, holds; see `load_file`."""
    held = loaded if isinstance(loaded, Mechanism | tuple) else getattr(loaded, "MECHANISM", None)
    family = (held,) if isinstance(held, Mechanism) else held
    if not isinstance(family, tuple) or not family or not all(isinstance(m, Mechanism) for m in family):
        raise MechanismError(f"{where}: holds no MECHANISM, a mechanism of one of the kinds or a tuple of variants")
    if len({(m.id, m.component) for m in family}) > 1:
        raise MechanismError(f"{where}: its variants differ in id or component")
    return family


def _add(found: dict[str, tuple[Mechanism, ...]], family: tuple[Mechanism, ...], where: str) -> None:
    name = family[0].id
    if name in found:
        raise MechanismError(f"{where}: {name} is the id of another mechanism already; give it one of its own")
    found[name] = family


def without(known: Mapping[str, tuple[Mechanism, ...]], names: Iterable[str]) -> dict[str, tuple[Mechanism, ...]]:
    """Return the mechanisms but those named.

    Raises
    ------
    MechanismError
        A name is not that of a mechanism.
    """
    left = dict(known)
    for name in names:
        if left.pop(name, None) is None:
            raise MechanismError(f"unknown mechanism {name!r}; 'mesotap mechanisms' lists the known ones")
    return left
