"""Scans read, form taken off, spectral moments and their intervals."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import stats

from analysis.surface.moments import analyse_scan, together, without_form
from analysis.surface.scan import SMALLEST_M, Scan, ScanError, parse_scan, read_scan

N = 64
Z = np.sin(np.arange(N))
PROFILE = "x_um,z_nm\n" + "\n".join(f"{0.5 * i},{100 * z:.6f}" for i, z in enumerate(Z))
MATRIX = "# unit: nm\n# spacing_um: 0.5\n" + "\n".join(",".join(f"{i * j % 7}" for j in range(N)) for i in range(40))


def gaussian_profile(rng, n=3000, step=0.25e-6, length=1.2e-6, R_q=100e-9):
    """Heights with the autocorrelation R_q^2 exp(-x^2 / 4 l^2)."""
    half = int(8 * length / step)
    kernel = np.exp(-((np.arange(-half, half + 1) * step) ** 2) / (2 * length**2))
    kernel *= R_q / np.sqrt((kernel**2).sum())
    return Scan(np.convolve(rng.standard_normal(n + 2 * half), kernel, "valid"), (step,))


def test_columns_with_units():
    scan = parse_scan(PROFILE)
    np.testing.assert_allclose(scan.height, 1e-7 * Z, atol=1e-14)
    assert scan.spacing == pytest.approx((0.5e-6,))


@pytest.mark.parametrize("header", ["x [um]\tz [nm]", "X(µm)\tZ(nm)", '"x_um"\t"z_nm"'])
def test_headers_as_instruments_write_them(header):
    text = header + "\n" + "\n".join(f"{0.5 * i}\t{100 * z:.6f}" for i, z in enumerate(Z))
    np.testing.assert_allclose(parse_scan(text).height, 1e-7 * Z, atol=1e-14)


def test_decimal_commas():
    text = "x_mm;z_um\n" + "\n".join(f"{0.5 * i};{z:.6f}".replace(".", ",") for i, z in enumerate(Z))
    np.testing.assert_allclose(parse_scan(text).height, 1e-6 * Z, atol=1e-12)


@pytest.mark.parametrize("cell", ["0,{:04d}", '"0,{:04d}"', '"5,{:03d}.0"'])
def test_commas_within_numbers_are_not_taken_for_separators(cell):
    rows = "\n".join(",".join(cell.format(37 * i * j % 900) for j in range(N)) for i in range(40))
    with pytest.raises(ScanError, match=r"line [34] holds (something that is not a number|a number that beg)"):
        parse_scan("# unit: um\n# spacing_um: 0.5\n" + rows, "scan.csv")


def test_quoted_decimal_commas_between_semicolons():
    text = '"x_mm";"z_um"\n' + "\n".join(f'"{0.5 * i}";"{z:.6f}"'.replace(".", ",") for i, z in enumerate(Z))
    np.testing.assert_allclose(parse_scan(text).height, 1e-6 * Z, atol=1e-12)


def test_matrix_with_declared_units():
    scan = parse_scan(MATRIX)
    assert scan.height.shape == (40, N)
    assert scan.height[3, 4] == pytest.approx(5e-9)
    assert scan.spacing == pytest.approx((0.5e-6, 0.5e-6))


def test_one_column_with_units_from_outside():
    scan = parse_scan("\n".join(map(str, Z)), unit="um", spacing_um=2.0)
    np.testing.assert_allclose(scan.height, 1e-6 * Z)


def test_lines_that_end_with_a_separator():
    text = "\n".join(line + "," for line in PROFILE.splitlines())
    np.testing.assert_allclose(parse_scan(text).height, 1e-7 * Z, atol=1e-14)


def test_points_of_a_map_in_any_order():
    points = [(x, y) for y in range(40) for x in range(36)]
    np.random.default_rng(1).shuffle(points)
    text = "x_um,y_um,z_nm\n" + "\n".join(f"{x},{2 * y},{x + 100 * y}" for x, y in points)
    scan = parse_scan(text)
    assert scan.height[7, 3] == pytest.approx(703e-9)
    assert scan.spacing == pytest.approx((1e-6, 2e-6))


def test_missing_points_are_filled_in():
    lines = PROFILE.splitlines()
    lines[11] = lines[11].split(",")[0] + ","
    scan = parse_scan("\n".join(lines))
    assert scan.missing == 1
    assert scan.height[10] == pytest.approx((scan.height[9] + scan.height[11]) / 2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "holds no numbers"),
        ("x_um,z_nm\n", "holds a header but no numbers"),
        ("x_um,z_nm\n1,2\n3,four", "line 3"),
        ("x_um,z_nm\n1,2\n3,4,5", "line 3 has 3 numbers"),
        ("x,z\n1,2", "does not name a unit"),
        ("x_furlong,z_nm\n1,2", "does not name a unit"),
        ("a,b\n1,2", "not a header with x and z"),
        ("1,2\n3,4", "unit of its heights"),
        ("# unit: nm\n1,2\n3,4", "how far apart"),
        ("# unit: nm\n# spacing_um: wide\n1,2", "which is not a spacing"),
        (PROFILE.replace("\n0.5,", "\n0.7,"), "not evenly spaced along x"),
        ("\n".join(PROFILE.splitlines()[:20]), "too few"),
        ("x_um,z_nm\n" + "\n".join(f"{i},5" for i in range(40)), "all heights are the same"),
        ("x_um,z_nm\n" + "\n".join(f"{i}," for i in range(40)), "were not measured"),
        ("x_um,x_um,z_nm\n1,2,3", "names x twice"),
        ("x_um,y_um,z_nm\n" + "\n".join(f"{i},{i},1" for i in range(40)), "no full grid"),
        ("x_um,z_nm\n1,inf", "line 2"),
        ("x_um,z_nm\n1,1_000", "line 2"),
        ("# unit: nm\n# spacing_um: 1\n# Unit: um\n1,2", "line 3 declares 'unit' again"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(text, said):
    with pytest.raises(ScanError, match=said) as caught:
        parse_scan(text, "scan.csv")
    assert str(caught.value).startswith("scan.csv: ")
    assert "\n" not in str(caught.value)


def test_a_file_of_bytes_is_refused(tmp_path):
    file = tmp_path / "scan.csv"
    file.write_bytes(bytes(range(128, 256)))
    with pytest.raises(ScanError, match="not a text file"):
        read_scan(file)


@settings(max_examples=200, deadline=None)
@given(st.text(alphabet="xyz_unm,;. \n\t0123456789-e#:", max_size=200))
def test_any_text_is_a_scan_or_a_sentence(text):
    try:
        scan = parse_scan(text)
    except ScanError:
        return
    assert np.isfinite(scan.height).all()


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(-1e3, 1e3), min_size=40, max_size=60).filter(lambda heights: np.ptp(heights) > 2e9 * SMALLEST_M),
    st.sampled_from([",", ";", "\t"]),
)
@example([0.0] * 39 + [3e9 * SMALLEST_M], ",")
def test_what_is_written_is_read(heights, separator):
    text = f"x_um{separator}z_nm\n" + "\n".join(f"{i}{separator}{z!r}" for i, z in enumerate(heights))
    np.testing.assert_allclose(parse_scan(text).height, 1e-9 * np.array(heights), atol=1e-18)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_form_of_its_degree_vanishes(degree):
    x, y = np.meshgrid(np.linspace(0, 1, 50), np.linspace(0, 2, 40))
    form = sum((x + 2 * y) ** k for k in range(degree + 1))
    assert np.abs(without_form(form, degree)).max() < 1e-9


def test_moments_of_a_sine():
    # amplitude a, wave number q: m0 = a^2 / 2, m2 = q^2 m0, m4 = q^4 m0; bandwidth of one wave: 1
    a, q, step = 50e-9, 2 * np.pi / 10e-6, 0.05e-6
    answer = analyse_scan(Scan(a * np.sin(q * step * np.arange(20000)), (step,)), degree=0).parameters
    assert answer.R_q.value == pytest.approx(a / np.sqrt(2), rel=1e-3)
    assert answer.m2.value == pytest.approx(q**2 * a**2 / 2, rel=2e-3)
    assert answer.m4.value == pytest.approx(q**4 * a**2 / 2, rel=2e-3)
    assert answer.bandwidth == pytest.approx(1, rel=5e-3)
    assert answer.R_s.value == pytest.approx(0.375 * np.sqrt(np.pi / answer.m4.value))
    assert answer.eta.value == pytest.approx(q**2 / (6 * np.pi * np.sqrt(3)), rel=2e-3)


def test_intervals_hold_the_moments():
    """300 profiles; expected moments of the differences from the autocorrelation. 0.9 to 0.98 of the intervals hold."""
    rng = np.random.default_rng(1)
    step, length, R_q = 0.25e-6, 1.2e-6, 100e-9
    r = R_q**2 * np.exp(-((step * np.arange(3)) ** 2) / (4 * length**2))
    m2, m4 = 2 * (r[0] - r[1]) / step**2, (6 * r[0] - 8 * r[1] + 2 * r[2]) / step**4
    inside = np.zeros(3)
    for _ in range(300):
        p = analyse_scan(gaussian_profile(rng), degree=0).parameters
        pairs = ((p.R_q, R_q), (p.R_s, 0.375 * np.sqrt(np.pi / m4)), (p.eta, m4 / m2 / (6 * np.pi * np.sqrt(3))))
        inside += [e.low <= truth <= e.high for e, truth in pairs]
    assert (inside / 300 >= 0.90).all()
    assert (inside / 300 <= 0.985).all()


def test_a_map_of_an_isotropic_surface_agrees_with_its_profiles():
    rng = np.random.default_rng(2)
    q = np.fft.fftfreq(256)
    keep = np.exp(-((np.hypot(*np.meshgrid(q, q)) * 30) ** 2))
    z = np.fft.ifft2(np.fft.fft2(rng.standard_normal((256, 256))) * keep).real * 1e-7
    whole = analyse_scan(Scan(z, (1e-6, 1e-6)), degree=0).parameters
    rows = [analyse_scan(Scan(row, (1e-6,)), degree=0).parameters.m2.value for row in z[::8]]
    assert whole.m2.value == pytest.approx(np.mean(rows), rel=0.15)


def test_moments_of_two_surfaces_add():
    rng = np.random.default_rng(3)
    one, other = (analyse_scan(gaussian_profile(rng, R_q=R)).parameters for R in (80e-9, 60e-9))
    both = together([one, other])
    assert both.R_q.value == pytest.approx(np.hypot(one.R_q.value, other.R_q.value))
    assert both.R_s.value**-2 == pytest.approx(one.R_s.value**-2 + other.R_s.value**-2)


def test_white_noise_is_a_matter_of_sampling():
    answer = analyse_scan(Scan(1e-7 * np.random.default_rng(4).standard_normal(4000), (1e-6,)))
    assert any("belong to the spacing" in note for note in answer.notes)


def test_lay_is_seen():
    z = np.tile(np.random.default_rng(5).standard_normal(200), (100, 1)) + 0.1 * np.random.default_rng(
        6
    ).standard_normal((100, 200))
    assert any("lay" in note for note in analyse_scan(Scan(1e-7 * z, (1e-6, 1e-6))).notes)


def test_correlation_length():
    # exp(-x^2 / 4 l^2) falls to 1 / e at 2 l
    answer = analyse_scan(gaussian_profile(np.random.default_rng(7), n=40000), degree=0)
    assert answer.correlation_length == pytest.approx(2.4e-6, rel=0.05)
    assert answer.kurtosis == pytest.approx(3, abs=0.3)


@pytest.mark.parametrize("degree", [-1, 7])
def test_form_of_no_degree(degree):
    with pytest.raises(ScanError, match="degree"):
        analyse_scan(parse_scan(PROFILE), degree)


def test_form_alone_is_no_roughness():
    with pytest.raises(ScanError, match="nothing is left"):
        analyse_scan(Scan(np.linspace(0, 1e-3, 100), (1e-6,)))


def test_uncertainty_of_the_sum_is_smaller_than_of_its_parts():
    rng = np.random.default_rng(8)
    parts = [analyse_scan(gaussian_profile(rng)).parameters for _ in range(4)]
    relative = [p.m0.standard_error / p.m0.value for p in parts]
    both = together(parts)
    assert both.m0.standard_error / both.m0.value == pytest.approx(
        np.sqrt(sum((r * p.m0.value / both.m0.value) ** 2 for r, p in zip(relative, parts, strict=True)))
    )
    assert stats.t.ppf(0.975, both.dof) == pytest.approx((both.m0.high - both.m0.value) / both.m0.standard_error)
