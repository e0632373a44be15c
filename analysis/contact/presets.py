"""Contacts by name, built from the published tables."""

from __future__ import annotations

import functools
from importlib import resources
from typing import Any, Literal

import yaml

from analysis.contact.elastic import combined_roughness
from analysis.settings import FlatContact, Material, SphereContact

Resolved = SphereContact | FlatContact


@functools.cache
def published_numbers() -> dict[str, Any]:
    """Return the published numbers (published.yaml): tables, quoted values and where they contradict each other."""
    text = (resources.files("analysis") / "published.yaml").read_text(encoding="utf-8")
    numbers: dict[str, Any] = yaml.safe_load(text)
    return numbers


def resolve(contact: Literal["paper-flat", "paper-sphere"] | Resolved) -> Resolved:
    """Return surfaces and materials behind the setting ``analysis.contact``: a preset's, or those given."""
    if isinstance(contact, (SphereContact, FlatContact)):
        return contact
    tables = published_numbers()["tables"]
    if contact == "paper-sphere":
        table = tables[2]
        sphere, flat = table["bodies"]
        asperities = tables[4]["combined"]
        return SphereContact(
            upper=_material(sphere),
            lower=_material(flat),
            radius_um=sphere["radius_um"],
            roughness_rq_um=combined_roughness([sphere["roughness_rq_um"], flat["roughness_rq_um"]]),
            asperity_radius_um=asperities["asperity_radius_um"],
            asperity_density_per_um2=asperities["asperity_density_per_um2"],
        )
    if contact == "paper-flat":
        table = tables[4]
        upper, lower = table["bodies"]
        combined = table["combined"]
        return FlatContact(
            upper=_material(upper),
            lower=_material(lower),
            nominal_area_mm2=table["nominal_area_mm2"],
            roughness_rq_um=combined["roughness_rq_um"],
            asperity_radius_um=combined["asperity_radius_um"],
            asperity_density_per_um2=combined["asperity_density_per_um2"],
        )
    raise ValueError(f"there is no contact {contact!r}; give paper-flat, paper-sphere or surfaces and materials")


def _material(body: dict[str, Any]) -> Material:
    return Material(
        youngs_modulus_gpa=body["youngs_modulus_gpa"],
        poisson_ratio=body["poisson_ratio"],
        hardness_gpa=body["hardness_gpa"],
    )
