"""A question to the catalogue as SQL."""

from __future__ import annotations

import math

from mesotap.catalogue.entry import UNREADABLE
from mesotap.catalogue.question import OF_LOAD, TEXTS, All, Is, Node, Not, OneOf, Within, Words

Clause = tuple[str, list[object]]
_COLUMN = {"load": "load_mn", "kc": "k_c", "zeta": "zeta", "f2": "f2_hz", "f1": "f1_hz", "noise": "noise_m_s2"}
_LOAD_KEYS = tuple(OF_LOAD)


def clause_for(question: Node) -> Clause:
    """Return a condition on rows of ``session`` and its parameters.

    What is asked of loads side by side is asked of one load: ``load:300..500 kc:5..`` is a session that was stiff at
    such a load, not one that was stiff at any and loaded so at another.
    """
    match question:
        case Words(columns, text):
            wanted = f"{{{' '.join(columns)}}} : {_phrase(text)}" if columns else _phrase(text)
            return "id IN (SELECT rowid FROM words WHERE words MATCH ?)", [wanted]
        case Is("mechanism", value):
            return "id IN (SELECT session FROM mechanism WHERE mechanism = ?)", [value]
        case Is("software", value):
            return "instr(software, ?) > 0", [value]
        case Is(key, value):
            return f"{key} = ?", [int(value) if isinstance(value, bool) else value]
        case Within(key):
            return _on_one_load([question]) if key in _LOAD_KEYS else _bounds(question)
        case Not(part):
            inner, values = clause_for(part)
            if _known_of_all(part):
                return f"NOT coalesce({inner}, 0)", values
            # of a session that cannot be read nobody knows that it is not so
            marks = ", ".join("?" * len(UNREADABLE))
            return f"(NOT coalesce({inner}, 0) AND state NOT IN ({marks}))", [*values, *UNREADABLE]
        case OneOf(parts):
            return _joined([clause_for(part) for part in parts], " OR ", "0")
        case All(parts):
            of_load = [p for p in parts if isinstance(p, Within) and p.key in _LOAD_KEYS]
            clauses = [clause_for(p) for p in parts if not (isinstance(p, Within) and p.key in _LOAD_KEYS)]
            return _joined([*clauses, *([_on_one_load(of_load)] if of_load else [])], " AND ", "1")
    raise TypeError(question)


def _known_of_all(question: Node) -> bool:
    """Whether what is asked is known of a session that cannot be read, too: how it stands and what it is called."""
    match question:
        case Not(part):
            return _known_of_all(part)
        case OneOf(parts) | All(parts):
            return all(_known_of_all(part) for part in parts)
        case Words(columns):
            return columns == TEXTS["name"]
        case Is(key):
            return key == "state"
    return False


def _joined(clauses: list[Clause], word: str, empty: str) -> Clause:
    if not clauses:
        return empty, []
    return f"({word.join(sql for sql, _ in clauses)})", [value for _, values in clauses for value in values]


def _on_one_load(terms: list[Within]) -> Clause:
    within, values = _joined([_bounds(t) for t in terms], " AND ", "1")
    return f"id IN (SELECT session FROM load WHERE {within})", values


def _bounds(term: Within) -> Clause:
    column = _COLUMN.get(term.key, term.key)
    ends = [(">=", term.low), ("<=", term.high)]
    said: list[Clause] = [(f"{column} {sign} ?", [end]) for sign, end in ends if math.isfinite(end)]
    return _joined(said, " AND ", f"{column} IS NOT NULL")


def _phrase(text: str) -> str:
    """Return the words of a text one after the other, the last of which may go on."""
    return '"' + text.replace('"', " ") + '" *'
