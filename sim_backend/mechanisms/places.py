"""Where in a rig a mechanism can act: numbers of its elements, bodies, channels or inputs."""

from __future__ import annotations

from collections.abc import Sequence

from sim_backend.arrangement import Arrangement, Role, Row

Place = tuple[int, ...]
"""Numbers in an arrangement: elements, a body, channels or inputs; empty where a mechanism acts on the whole rig."""


def fitting_elements(
    rig: Arrangement, fits: Sequence[Role], preloaded: bool | None = None, undamped: bool = False
) -> list[Place]:
    """Return the elements of some roles, one for each distinct deformation; equal elements share a place.

    Parameters
    ----------
    fits
        Roles, likeliest first: so are the elements. One that carries the preload, which has laws of its own, is left
        out where there are others, unless it has the first of the roles.
    preloaded
        Whether the element must carry the preload (True) or must not (False).
    undamped
        Whether nothing on the same deformation may have a damper.
    """
    by_row: dict[Row, list[int]] = {}
    for i, e in enumerate(rig.elements):
        by_row.setdefault(e.row, []).append(i)
    found = []
    for group in by_row.values():
        if undamped and any(rig.elements[i].damping is not None for i in group):
            continue
        own = [i for i in group if rig.elements[i].role in fits and preloaded in (None, rig.elements[i].preload)]
        if own:
            found.append(min(own, key=lambda i: fits.index(rig.elements[i].role)))
    found.sort(key=lambda i: fits.index(rig.elements[i].role))
    own = [i for i in found if rig.elements[i].role == fits[0] or not rig.elements[i].preload]
    return list(dict.fromkeys(_equal_to(rig, i) for i in own or found))


def _equal_to(rig: Arrangement, element: int) -> Place:
    group = rig.elements[element].alike
    return (element,) if group is None else tuple(i for i, e in enumerate(rig.elements) if e.alike == group)


def every_body(rig: Arrangement) -> list[Place]:
    """Return all bodies."""
    return [(i,) for i in range(len(rig.bodies))]


def channels_alike(rig: Arrangement) -> list[Place]:
    """Return groups of channels that show the same: one quantity of one body."""
    groups: dict[tuple[Row, str], list[int]] = {}
    for i, s in enumerate(rig.sensors):
        groups.setdefault((s.row, s.quantity), []).append(i)
    return [tuple(g) for g in groups.values()]


def channels_that_differ(rig: Arrangement) -> list[Place]:
    """Return channels that can differ from the others: each of several.

    Of a pair that shows the same, and that nothing else tells apart, the second.
    """
    if len(rig.sensors) < 2:
        return []
    pair = len(rig.sensors) == 2 and len(channels_alike(rig)) == 1 and not rig.inputs
    return each_channel(rig)[1:] if pair else each_channel(rig)


def each_channel(rig: Arrangement) -> list[Place]:
    """Return every channel by itself."""
    return [(i,) for i in range(len(rig.sensors))]


def each_input(rig: Arrangement) -> list[Place]:
    """Return every measured input by itself."""
    return [(i,) for i in range(rig.inputs)]


def preloaded_contact(rig: Arrangement) -> list[Place]:
    """Return the contact that carries the load, where there is one."""
    return [(i,) for i, e in enumerate(rig.elements) if e.preload]


def grounded_elements(rig: Arrangement, roles: Sequence[Role]) -> list[Place]:
    """Return elements between a body and the ground."""
    return [(i,) for i, e in enumerate(rig.elements) if e.role in roles and len(e.row) == 1 and _is_number(e.row)]


def _is_number(row: Row) -> bool:
    return all(not isinstance(coefficient, str) for _, coefficient in row)


def unused_name(name: str, taken: Sequence[str]) -> str:
    """Return a name that is not taken: this one, or with primes."""
    while name in taken:
        name += "'"
    return name
