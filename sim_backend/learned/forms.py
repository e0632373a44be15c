"""What a family of laws is that a law is learned from, and how its mechanisms are built."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

from sim_backend.arrangement import Arrangement, Role
from sim_backend.mechanisms.kinds import ForceLaw, Mechanism, Quantity, Scale, Values
from sim_backend.mechanisms.places import Place

Kind = Literal["static", "rate", "memory", "time", "load", "sensor", "input", "clock", "dynamics"]
Symmetry = Literal["odd", "even", "none"]

LEARNED: Final = "learned"
"""Source of the mechanisms that laws are learned from."""
FORM: Final = "form"
"""Fixed value that says which family a learned law is of: its number."""
FORCE, IN_DEFLECTION, IN_RATE, IN_LOAD = "force_n", "deflection_exponent", "rate_exponent", "load_exponent"
AT_DEFLECTION, AT_RATE, AT_LOAD = "reference_deflection_m", "reference_rate_m_per_s", "reference_load_n"
TIME: Final = "time_s"

SMALL = 1e-4  # of the element's force: what is screened has an effect in proportion to it
LOADS = (0.0, 1.0)  # exponents of the load that are screened
LOAD_EXPONENT = Quantity(IN_LOAD, "1", -3.0, 3.0, "exponent of the load, by which the force grows with it")


@dataclass(frozen=True, slots=True, kw_only=True)
class LearnedForce(ForceLaw):
    """A force law in any one element, or in all equal ones."""

    def places(self, rig: Arrangement) -> list[Place]:
        """Return an element for each distinct deformation, each by itself and together with those equal to it."""
        by_row: dict[Any, list[int]] = {}
        for i, e in enumerate(rig.elements):
            if e.role in self.fits and e.preload is bool(self.preloaded):
                by_row.setdefault(e.row, []).append(i)
        alone = [min(own, key=lambda i: self.fits.index(rig.elements[i].role)) for own in by_row.values()]
        groups = {e.alike for e in rig.elements if e.alike is not None}
        equal = [tuple(i for i, e in enumerate(rig.elements) if e.alike == g) for g in sorted(groups)]
        together = [g for g in equal if all(rig.elements[i].role in self.fits for i in g) and not self.preloaded]
        return [(i,) for i in alone] + [g for g in together if len(g) > 1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """A family of laws.

    Attributes
    ----------
    number, key
        What the fixed value `FORM` is, and its name in files.
    name
        In words, for a sentence: "an odd power of the deflection".
    conservative
        None where recordings do not tell.
    text
        The formula, of values.
    exponents
        Which parameter is the exponent in deflection, rate or signal.
    mechanism
        Its mechanism where it does not carry the load; ``loaded`` where it does (None: it does not act there).
    formula
        Whether ``text`` says it all.
    """

    number: int
    key: str
    name: str
    kind: Kind
    symmetry: Symmetry
    conservative: bool | None
    text: Callable[[Values], str]
    exponents: Mapping[str, str] = field(default_factory=dict)
    mechanism: Mechanism | None = None
    loaded: Mechanism | None = None
    formula: bool = True

    @property
    def mechanisms(self) -> list[Mechanism]:
        """Those that there are."""
        return [m for m in (self.mechanism, self.loaded) if m is not None]

    def with_forces(
        self,
        law: Any,
        own: Sequence[Quantity],
        begins: Sequence[Mapping[str, float]],
        constants: Callable[[Values], Sequence[float]],
        roles: tuple[Role, ...],
        jumps: bool = False,
    ) -> Form:
        """Return the family with its law in elements, without and with the load.

        Parameters
        ----------
        law
            Compiled.
        own, begins
            Its parameters beside the force, and the values of them that are screened; of a time over the duration.
        constants
            From values what the law takes after the force.
        roles
            Of the elements that it acts in, likeliest first.
        """

        def trials(scale: Scale, loaded: bool) -> list[dict[str, float]]:
            at = {FORM: float(self.number), FORCE: SMALL * scale.force, **references(scale)}
            each = [{**at, **b, **({TIME: b[TIME] * scale.duration_s} if TIME in b else {})} for b in begins]
            return [{**b, IN_LOAD: q} for b in each for q in LOADS] if loaded else each

        def built(loaded: bool) -> ForceLaw:
            return LearnedForce(
                id=f"learned_{self.kind}",
                component="",
                summary=f"a law learned from recordings: {self.name}",
                source=LEARNED,
                parameters=(
                    Quantity(FORCE, "N", -1e25, 1e25, "force at the references"),
                    *own,
                    *((LOAD_EXPONENT,) if loaded else ()),
                ),
                strength=FORCE,
                trials=lambda scale: trials(scale, loaded),
                statement=self.statement,
                law=law,
                constants=lambda values, rest: (values[FORCE] * by_load(values, rest.preload), *constants(values)),
                fits=roles,
                preloaded=loaded,
                one_signed=False,
                with_time=self.kind == "time",
                jumps=jumps,
            )

        return replace(self, mechanism=built(False), loaded=built(True))

    def statement(self, values: Values, name: str) -> str:
        """Say what a law of the family is."""
        return self.said(self.text(values), name)

    def said(self, formula: str, where: str) -> str:
        """Say what a force with this formula is."""
        return f"In the {where} acts a force that no mechanism listed has: {self.name}, {formula}."


def held(mechanism: Mechanism, names: Sequence[str]) -> Mechanism:
    """Return a mechanism some of whose parameters stay at the values that a term gives them."""
    return replace(mechanism, parameters=tuple(q for q in mechanism.parameters if q.name not in names))


def at_one_load(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism without an exponent of the load, which a single load does not tell."""
    if all(q.name != IN_LOAD for q in mechanism.parameters):
        return mechanism

    def trials(scale: Scale) -> list[dict[str, float]]:
        return [{**t, IN_LOAD: 0.0} for t in mechanism.trials(scale) if t[IN_LOAD] == LOADS[0]]

    return held(replace(mechanism, trials=trials), (IN_LOAD,))


def references(scale: Scale) -> dict[str, float]:
    """Return what a law is counted in: the typical motion, and the load."""
    load = scale.static * scale.force / scale.deformation
    return {AT_DEFLECTION: scale.deformation, AT_RATE: scale.rate, AT_LOAD: load or 1.0}


def by_load(values: Values, preload: float) -> float:
    """Return by what factor the force is larger than at the reference load."""
    exponent = values.get(IN_LOAD, 0.0)
    return float((preload / values[AT_LOAD]) ** exponent) if exponent and preload > 0 else 1.0


def number(value: float) -> str:
    """Write a number of a formula."""
    return f"{value:.4g}"


def over(symbol: str, reference: float, unit: str) -> str:
    """Write a variable over its reference."""
    return f"{symbol} / {reference:.4g} {unit}"


def times_load(values: Values) -> str:
    """Write the factor of the load."""
    exponent = values.get(IN_LOAD, 0.0)
    return f" * (P / {1e3 * values[AT_LOAD]:.4g} mN)**{number(exponent)}" if exponent else ""


def power_text(symbol: str, reference: float, unit: str, exponent: float, odd: bool) -> str:
    """Write a power of a variable over its reference; a whole one without the magnitude."""
    whole = exponent == round(exponent) and exponent % 2 == float(odd)
    inner = f"({over(symbol, reference, unit)})" if whole else f"abs({over(symbol, reference, unit)})"
    power = inner if exponent == 1 else f"{inner}**{number(exponent)}"
    return power if whole or not odd else f"sign({symbol}) * {power}"
