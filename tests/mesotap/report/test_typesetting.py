"""What a page makes of a sentence that a terminal shows too."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markupsafe import Markup

from mesotap.report.typesetting import parameter, prose, unit


@pytest.mark.parametrize(
    ("said", "set_as"),
    [
        ("nothing (p < 1e-12), or p = 2.5e-07", "nothing (p &lt; 10⁻¹²), or p = 2.5 × 10⁻⁷"),
        ("by -0.03 mN, from 50% to 3 %", "by −0.03 mN, from 50\N{NO-BREAK SPACE}% to 3\N{NO-BREAK SPACE}%"),
        ("k_c and zeta2 from f2", "<i>k</i><sub>c</sub> and <i>ζ</i><sub>2</sub> from <i>f</i><sub>2</sub>"),
        ("a spring k_s in series", "a spring <i>k</i><sub>s</sub> in series"),
        ("0.02 m/s2 <b>", "0.02 m/s² &lt;b&gt;"),
        ("of 2.4 um and R_q^(3/2), per um2", "of 2.4 µm and <i>R</i><sub>q</sub><sup>3/2</sup>, per µm²"),
        ("m/s2", "m/s²"),
        ("zeta of A_n, P_0", "<i>ζ</i> of <i>A</i><sub>n</sub>, <i>P</i><sub>0</sub>"),
        ("(1 - nu^2), 7900 kg/m3", "(1 - nu²), 7900 kg/m³"),
        ("0.0001844 N * (d / 4.091e-09 m)**3", "0.0001844 N * (d / 4.091e-09 m)**3"),
        ("see f2.csv, f2_hz, rig/k1 and page1e-2.html", "see f2.csv, f2_hz, rig/k1 and page1e-2.html"),
    ],
)
def test_numbers_and_symbols_are_set_and_names_are_left(said: str, set_as: str) -> None:
    assert prose(said) == Markup(set_as)


@pytest.mark.parametrize(
    ("said", "set_as"),
    [
        ("c_c / P 0.5 (‹0.1 to 2) s/m", "<i>c</i><sub>c</sub> / <i>P</i> 0.5 (‹0.1 to 2) s/m"),
        ("R_q over measured 0.92 (0.8 to 1.1)", "<i>R</i><sub>q</sub> over measured 0.92 (0.8 to 1.1)"),
        ("zeta at 0.5 N 0.2 (0.1 to 0.3) %", "<i>ζ</i> at 0.5 N 0.2 (0.1 to 0.3) %"),
        ("H 3 (-1 to 4) GPa", "<i>H</i> 3 (−1 to 4) GPa"),
    ],
)
def test_a_fitted_parameter_has_its_symbols_set(said: str, set_as: str) -> None:
    assert parameter(said) == Markup(set_as)


@given(st.text(alphabet=st.sampled_from("k_cf2zeta1m e-+0.9^%<>&\"'/()"), max_size=40))
def test_no_text_makes_an_element_of_its_own(text: str) -> None:
    assert re.sub(r"</?(?:i|sub|sup)>", "", prose(text)).count("<") == 0
    assert prose(text).unescape().replace("\N{NO-BREAK SPACE}", " ").count("<") >= text.count("<")


@pytest.mark.parametrize(
    ("plain", "raised"), [("m/s2", "m/s²"), ("N/m3", "N/m³"), ("m/N s2", "m/(N s²)"), ("N s/m", "N s/m"), ("1", "")]
)
def test_units_are_raised(plain: str, raised: str) -> None:
    assert unit(plain) == raised
