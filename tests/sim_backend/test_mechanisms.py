"""The catalogue of mechanisms: where each acts, a user's own beside the program's, and what all of them keep to."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rig.plugins import PluginError
from sim_backend.adopted import ANY_RIG, adopted
from sim_backend.mechanisms import channel_skew, undeclared_filter
from sim_backend.mechanisms.catalogue import PARTS, MechanismError, catalogue, load_file, placed, variants
from sim_backend.mechanisms.conformance import benches, conformance, is_unit
from sim_backend.mechanisms.kinds import ForceLaw

PACKAGE = Path(undeclared_filter.__file__).parent
FILES = sorted(p for p in PACKAGE.glob("[!_]*.py") if p.stem not in PARTS)
EXAMPLE = Path(__file__).parents[1] / "example_package" / "mesotap_example" / "cubed_rate_damping.py"
SMALL = benches()[1].rig
BAD = """
from sim_backend.mechanisms.kinds import ForceLaw, Quantity, law

@law
def force_law(force, d, v, t, p, before, after):
    return force - p[4] * v

MECHANISM = ForceLaw(
    id="engine", component="contact", summary="", source="",
    parameters=(Quantity("power", "furlong", 0.0, 1.0, ""),), strength="power",
    trials=lambda scale: [{"power": 2.0}], law=force_law, fits=("contact",),
    constants=lambda values, rest: (1e3 * values["power"],), statement=lambda values, name: "It drives.",
)
"""


@pytest.mark.parametrize("file", [*FILES, EXAMPLE], ids=lambda p: p.stem)
def test_a_mechanism_keeps_to_what_all_have_to(file: Path) -> None:
    assert [c for c in conformance(file) if not c.holds] == []


def test_an_engine_with_a_unit_of_its_own_is_found_out(tmp_path: Path) -> None:
    file = tmp_path / "engine.py"
    file.write_text(BAD)
    failed = {c.name for c in conformance(file) if not c.holds}
    assert failed == {
        "its units are units",
        *(f"trials lie within the parameters' ranges in {rig}" for rig in ("the tester", "a described rig")),
        *(f"it delivers no net work over a closed cycle in {rig}" for rig in ("the tester", "a described rig")),
    }


@pytest.mark.parametrize("unit", ["1", "m", "N s/m", "N s2/m2", "N/m3", "m/s2", "1/s", "samples"])
def test_units(unit: str) -> None:
    assert is_unit(unit)


@pytest.mark.parametrize("unit", ["", "furlong", "N/m/s", "m^2", "N*m", "2 m"])
def test_no_units(unit: str) -> None:
    assert not is_unit(unit)


def test_equal_springs_share_a_place_in_the_tester() -> None:
    assert catalogue()["tube_spring_cubic"][0].places(ANY_RIG) == [(0, 1)]


@pytest.mark.parametrize(
    ("name", "tester", "described"),
    [
        ("hertz_stiffness", [(2,)], []),  # needs a preload
        ("contact_loss", [(2,)], []),
        ("guide_friction", [(3,), (0, 1)], [(4,), (5,), (2,), (3,)]),  # the guide first; not the loaded contact
        ("tube_spring_cubic", [(0, 1)], [(0,), (5,), (2,), (3,)]),  # the springs first
        ("attached_mass", [(0,), (1,)], [(0,), (1,)]),  # each body, seen or not
        ("frame_compliance", [(0,), (1,)], [(0,), (3,), (5,)]),  # whatever stands on the ground
        ("rocking", [(2, 0, 1)], []),  # needs two sensors on a body
        ("channel_skew", [(1,)], [(0,), (1,)]),
        ("clipping", [(0, 1)], [(0,), (1,)]),
        ("undeclared_filter", [], [(0,), (1,)]),  # a measured input shows it
        ("input_curvature", [], [(0,)]),
        ("double_hit", [()], []),  # a measured input shows it
        ("mains_hum", [()], [()]),
        ("load_drift", [], []),
        ("base_motion", [(0, 1)], []),  # needs equal springs on the ground
        ("upper_roll", [(2,)], []),
        ("cross_axis_sensitivity", [(2, 0), (2, 1)], []),  # either of two sensors on a body
        ("base_strain", [(2, 1)], []),
        ("cable_drag", [(1,)], [(1,)]),
        ("holder_compliance", [(2,)], []),
        ("converter_step", [(0,), (1,)], []),
    ],
)
def test_where_a_mechanism_acts(name: str, tester: list, described: list) -> None:
    (mechanism,) = catalogue()[name]
    assert (mechanism.places(ANY_RIG), mechanism.places(SMALL)) == (tester, described)


def test_of_one_id_only_what_fits_its_component_is_tried_in_the_tester() -> None:
    assert [place for _, place in placed(catalogue()["micro_slip"], ANY_RIG)] == [(2,)]
    assert [place for _, place in placed(catalogue()["end_stop"], ANY_RIG)] == [(0, 1)]


def test_what_a_free_decay_hides_says_so_and_is_like_something_known() -> None:
    known = catalogue()
    hidden = [m for m in variants(known) if m.hidden]
    assert {"holder_compliance", "air_film", "contact_relaxation", "plastic_loading", "sampling_jitter"} <= {
        m.id for m in hidden
    }
    assert all(len(m.hidden.split(". ")) > 1 for m in hidden)  # why, and what would tell it
    assert all(m.hidden for m in variants(known) if m.same_as)
    assert {other for m in hidden for other in m.same_as} <= set(known)


def test_a_base_beneath_both_tubes_is_like_a_foot_of_a_quarter_of_its_mass() -> None:
    """The mode in which both masses move together: its frequency and the base's own share in it."""

    def modes(name: str, mass: float, place: tuple[int, ...]) -> np.ndarray:
        mechanism = catalogue()[name][0]
        numbers = (mass, mass * (2 * np.pi * 150) ** 2 - 5e5 * len(place), 0.0)  # resonance with the tubes on it
        names = [q.name for q in mechanism.parameters]
        rig = mechanism.extend(ANY_RIG, dict(zip(names, numbers, strict=True)), place)  # type: ignore[attr-defined]
        m, _, k = rig.matrices(rig.declared())
        return np.sqrt(np.sort(np.linalg.eigvals(k / m[:, None]).real))[:2] / (2 * np.pi)

    base = modes("base_motion", 40.0, (0, 1))
    for foot in (0, 1):
        np.testing.assert_allclose(modes("frame_compliance", 10.0, (foot,)), base, rtol=2e-3)
    assert abs(modes("frame_compliance", 40.0, (0,)) / base - 1).max() > 5e-3


def test_variants_need_a_preload_or_its_absence() -> None:
    for family in catalogue().values():
        if len(family) > 1:
            assert {m.preloaded for m in family if isinstance(m, ForceLaw)} == {True, False}


@pytest.mark.parametrize(
    ("rate", "f", "corner", "error"),
    # straight lines between 13 samples a period would lose 2 %, more than such a filter takes away
    [(2000.0, 25.0, 40.0, 1e-10), (143.0, 10.7, 182.4, 1e-6), (143.0, 10.7, 5e4, 1e-6), (100.0, 20.0, 79.0, 1e-3)],
)
def test_an_undeclared_filter_is_a_first_order_low_pass(rate: float, f: float, corner: float, error: float) -> None:
    t = np.arange(4000) / rate
    shown = undeclared_filter.distort(np.sin(2 * np.pi * f * t)[None], {"corner_hz": corner}, rate)[0]
    h = 1 / (1 + 1j * f / corner)
    inner = slice(2000, -50)
    np.testing.assert_allclose(shown[inner], np.imag(h * np.exp(2j * np.pi * f * t[inner])), atol=error)


@pytest.mark.parametrize(("w", "delay", "error"), [(0.3, 0.06, 2e-4), (0.3, -0.06, 1e-7), (0.3, -2.3, 1e-8), (1, 3, 0)])
def test_a_delayed_channel_is_right_from_the_beginning_of_a_decay(w: float, delay: float, error: float) -> None:
    t, s = np.arange(300), -0.01 + 1j * w
    shown = channel_skew.distort(np.exp(s * t).real[None], {channel_skew.NAME: delay}, 1.0)[0]
    first = max(int(np.ceil(delay)), 0) if delay > 1 else 0  # what was more than a sample before the first is not known
    np.testing.assert_allclose(shown[first:280], np.exp(s * (t[first:280] - delay)).real, rtol=0, atol=error + 1e-9)


@pytest.mark.parametrize(("of_rate", "error"), [(0.2, 6e-7), (0.25, 5e-5), (0.3, 2e-3)])
@pytest.mark.parametrize("delay", [0.05, 0.5, -1.7])
def test_a_delayed_channel_is_right_of_fast_tones_but_at_the_ends(of_rate: float, error: float, delay: float) -> None:
    t = np.arange(400)
    shown = channel_skew.distort(np.sin(2 * np.pi * of_rate * t)[None], {channel_skew.NAME: delay}, 1.0)[0]
    inner = slice(20, -20)
    np.testing.assert_allclose(shown[inner], np.sin(2 * np.pi * of_rate * (t[inner] - delay)), rtol=0, atol=error)


@pytest.mark.parametrize("count", [1, 3, 11, 12, 25])
def test_a_delayed_channel_may_be_short(count: int) -> None:
    shown = channel_skew.distort(np.arange(count)[None] * 2.0, {channel_skew.NAME: 0.5}, 1.0)[0]
    expected = 2.0 * np.arange(count) - 1.0 if count > 1 else [0.0]
    np.testing.assert_allclose(shown, expected, atol=1e-9)


def test_without_a_measured_input_a_filter_is_seen_where_channels_show_other_things() -> None:
    rig = replace(SMALL, inputs=0)
    assert undeclared_filter.MECHANISM.places(rig) == [(0,), (1,)]


def test_a_shipped_file_is_the_programs_own_module() -> None:
    # compiled laws are kept on disk with the name of their module, which other processes have to know
    assert load_file(PACKAGE / "adhesion.py")[0] is catalogue()["adhesion"][0]


@pytest.fixture
def own_folder(tmp_path: Path) -> Path:
    shutil.copyfile(EXAMPLE, tmp_path / EXAMPLE.name)
    return tmp_path


def test_a_users_own_is_listed_beside_the_programs(own_folder: Path) -> None:
    own = catalogue([own_folder])
    assert set(own) - set(catalogue()) == {"cubed_rate_damping"}
    assert len(variants(own)) == len(variants(catalogue())) + 1


def test_a_users_own_can_be_simulated(own_folder: Path) -> None:
    found = adopted("cubed_rate_damping", {"cubed_rate_damping_n_s3_per_m3": 2.0}, [own_folder])
    assert found.place == (2,)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("x = 1", "holds no MECHANISM"),
        ("import nowhere", "cannot be imported: ModuleNotFoundError: No module named 'nowhere'"),
        ("from sim_backend.mechanisms.hertz_stiffness import MECHANISM", "hertz_stiffness is the id of another"),
        ("MECHANISM = ()", "holds no MECHANISM"),
    ],
)
def test_a_file_that_is_no_mechanism_is_refused_with_its_name(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "mine.py").write_text(text)
    with pytest.raises(PluginError, match=f"mine.py: .*{sentence}"):
        catalogue([tmp_path])


def test_a_folder_that_is_none_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MechanismError, match="is not a folder of mechanisms"):
        catalogue([tmp_path / "nowhere"])


def test_an_installed_package_can_offer_a_mechanism(monkeypatch: pytest.MonkeyPatch) -> None:
    from importlib.metadata import EntryPoint

    from rig import plugins
    from sim_backend.mechanisms import catalogue as module

    entry = EntryPoint("slip", "sim_backend.mechanisms.micro_slip", module.GROUP)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [entry])
    module._catalogue.cache_clear()
    (said,) = module.left_out()
    assert said.startswith("entry point slip ")
    assert "micro_slip is the id of another" in said
    assert module.family("micro_slip") is not None
    with pytest.raises(MechanismError, match="entry point slip"):
        module.family("none_such")
    module._catalogue.cache_clear()  # it knows of an entry point that is none


@pytest.mark.parametrize(
    ("curvature", "said"),
    [(1.00003, "recorded in rad"), ((np.pi / 180) ** 2, "recorded in degrees"), (0.25, "an arc of radius 2")],
)
def test_a_pendulum_s_deflection_is_said_to_be_its_angle_or_an_arc(curvature: float, said: str) -> None:
    (swing,) = catalogue()["large_swing"]
    assert said in swing.statement({"arc_curvature_per_m2": float(curvature)}, "pivot")


@pytest.mark.parametrize(("lag", "words"), [(-0.5, "that much later"), (0.5, "that much earlier")])
def test_a_channel_that_is_sampled_later_shows_what_the_others_show_later(lag: float, words: str) -> None:
    at = np.arange(40.0)
    shown = channel_skew.distort(at[None], {channel_skew.NAME: lag}, 1.0)[0]
    np.testing.assert_allclose(shown[5:-5], at[5:-5] - lag)
    said = channel_skew.MECHANISM.statement({channel_skew.NAME: lag}, "channel b")
    assert said.endswith(f"{words}.") or f"{words}," in said
    assert "0.5 samples" in said
