"""What is true of a law that nobody listed, in the words of the contract's ``law``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

KINDS_OF_LAW = ("static", "rate", "memory", "time", "load", "sensor", "input", "clock", "dynamics")

Told = Callable[[Mapping[str, Any]], tuple[str, ...]]
Powers = Callable[[Mapping[str, Any]], Mapping[str, float]]


def no_powers(character: Mapping[str, Any]) -> Mapping[str, float]:
    """Of a law that is no power of anything."""
    return {}


@dataclass(frozen=True, slots=True)
class Nature:
    """What a learned law is to say of an effect outside the list.

    Attributes
    ----------
    kind
        One of `KINDS_OF_LAW`.
    elements
        Names of the tester's elements, bodies or channels that are right, from the character. Elements of equal
        deformation are all right, and so are both tube springs: turning the sign of the contact mode, whose amplitude
        is free in each decay, makes a law in one of them that in the other but for the mixed terms of both modes.
    components
        Classes that are right beside the effect's own.
    powers
        Exponents of ``deflection``, ``rate`` and ``load``, from the character; those of a law that is no power are
        absent. The load's is 0 where the coefficient does not depend on it.
    conservative
        Whether it gives back what it takes; None where the question has no meaning.
    same
        Listed mechanisms of the very same equations: naming one is right.
    why
        Why they are the same, a sentence.
    absorbed
        Why the refit of Eq. 9 hides it, a sentence; empty where it does not. Such an effect is not drawn.
    """

    kind: str
    elements: Told
    powers: Powers = no_powers
    conservative: bool | None = None
    components: tuple[str, ...] = ()
    same: tuple[str, ...] = ()
    why: str = ""
    absorbed: str = ""

    def told(self, character: Mapping[str, Any]) -> dict[str, Any]:
        """Return what a truth file states of it."""
        return {
            "kind": self.kind,
            "elements": list(self.elements(character)),
            "components": list(self.components),
            "exponents": dict(self.powers(character)),
            "conservative": self.conservative,
            "same": list(self.same),
        }


def at(*elements: str) -> Told:
    """Return the elements of an effect that is always at the same place."""
    return lambda character: elements


def of_powers(**exponents: float) -> Powers:
    """Return the exponents of an effect that always has the same."""
    return lambda character: exponents
