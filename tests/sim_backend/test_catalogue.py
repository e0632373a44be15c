"""What the catalogue of mechanisms lists."""

from __future__ import annotations

from sim_backend.mechanisms.catalogue import catalogue


def test_every_mechanism_of_the_contract_is_listed() -> None:
    expected = {
        "hertz_stiffness": "contact", "rough_surface_stiffness": "contact", "contact_loss": "contact",
        "hunt_crossley_damping": "contact", "micro_slip": "contact", "quadratic_damping": "contact",
        "squeeze_film": "contact", "adhesion": "contact", "contact_creep": "contact", "guide_friction": "upper mass",
        "tube_spring_damping": "tube springs", "tube_spring_cubic": "tube springs", "attached_mass": "lower mass",
        "tube_mode": "tube springs",
        "frame_compliance": "frame", "rocking": "lower mass", "double_hit": "impactor",
        "undeclared_filter": "sensor chain", "channel_gain": "sensor chain", "channel_skew": "sensor chain",
        "clipping": "sensor chain", "mains_hum": "sensor chain", "load_drift": "load cell",
    }  # fmt: skip
    found = {name: family[0].component for name, family in catalogue().items()}
    assert {name: found[name] for name in expected} == expected
