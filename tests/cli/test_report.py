"""Values shown as zero: round-off compared with the forces and displacements of the model, and nothing else."""

from __future__ import annotations

from typing import Any

from ancf2d.case import Units
from ancf2d.cli.report import run_report
from ancf2d.cli.text import TIME, duration, number, table

FACTS = {"title": "", "solver": "linear_static", "elements": 2, "dofs": 12, "status": "converged", "wall_s": 0.1}


def shown(name: str, *, unbalanced: float = 0.0, extent: float = 2.0, **summary: Any) -> dict[str, str]:
    """The row of a probe or support by quantity."""
    lines = run_report({**FACTS, **summary}, Units(), extent, unbalanced).split("\n")
    k = next(k for k, line in enumerate(lines) if line.split()[:1] == [name])
    head = next(line for line in reversed(lines[:k]) if "[" in line)
    quantities = [word for word in head.split()[1:] if not word.startswith("[") and not word.endswith("]")]
    return dict(zip(quantities, lines[k].split()[1:], strict=True))


def reaction(fx: float, fy: float, m: float, **options: Any) -> dict[str, str]:
    return shown("a", reactions={"a": {"fx": fx, "fy": fy, "m": m}}, **options)


def test_moments_of_round_off_are_zero_compared_with_forces() -> None:
    assert reaction(0.0, 5e5, -5.2e-9) == {"fx": "0", "fy": "500000", "m": "0"}
    # at a long lever arm as at a short one, in whatever units
    assert reaction(0.0, 5e5, -5.2e-9, extent=2e-3)["m"] == "-5.2e-09"
    assert reaction(0.0, 5e-7, -5.2e-21)["m"] == "0"


def test_forces_of_round_off_are_zero_compared_with_moments() -> None:
    assert reaction(1.7e-15, 3.9e-14, -6.28) == {"fx": "0", "fy": "0", "m": "-6.28"}
    assert reaction(1.7e-9, 0.0, -6.28)["fx"] == "1.7e-09"


def test_rotations_of_round_off_are_zero_compared_with_displacements_and_vice_versa() -> None:
    probe = {"x": 1.0, "y": 1e-17, "ux": 0.0, "uy": -9.7e-5, "theta": -1.1e-19}
    assert shown("mid", probes={"mid": probe}) == {"x": "1", "y": "0", "ux": "0", "uy": "-9.7e-05", "theta": "0"}
    turned = {"x": 0.0, "y": 3e-17, "ux": 2e-17, "uy": 0.0, "theta": 0.5}
    assert shown("mid", probes={"mid": turned}) == {"x": "0", "y": "0", "ux": "0", "uy": "0", "theta": "0.5"}


def test_small_significant_values_are_shown() -> None:
    probe = {"x": 1.0, "y": 0.0, "ux": -4.7e-15, "uy": -9.7e-5, "theta": 1e-14}
    assert shown("mid", probes={"mid": probe})["ux"] == "-4.7e-15"
    assert shown("mid", probes={"mid": probe})["theta"] == "1e-14"
    assert reaction(6.4e-4, 5e5, 0.0)["fx"] == "0.00064"


def test_no_force_is_more_accurate_than_the_residual_force() -> None:
    assert reaction(6.4e-4, 5e5, 3e-3, unbalanced=2e-3) == {"fx": "0", "fy": "500000", "m": "0"}
    assert reaction(6.4e-4, 5e5, 5e-3, unbalanced=2e-3)["m"] == "0.005"
    # section forces of probes are forces as well
    probes = {"mid": {"N": 1e-3, "Q": 5e5, "M": 1e-3}}
    assert shown("mid", probes=probes, unbalanced=2e-3) == {"N": "0", "Q": "500000", "M": "0"}


def test_large_residual_forces_are_not_taken_for_round_off() -> None:
    assert reaction(100.0, 5e5, 0.0, unbalanced=1e4)["fx"] == "100"


def _found(**found: object) -> str:
    summary = {"title": "", "solver": "static", "status": "converged", "elements": 1, "dofs": 4, "iterations": 1,
               "steps": 1, "wall_s": 1.0, "probes": {}, "reactions": {}, **found}
    return run_report(summary, Units(), 1.0)


def test_modes_are_listed_with_their_kind_and_largest_share() -> None:
    mode = {"omega": 95.634, "hz": 15.22, "kind": "bending", "number": 2, "shares": {"axial": 0.1, "transverse": 0.9}}
    text = _found(frequencies=[mode])
    assert "95.634" in text
    assert "bending 2" in text
    assert "transverse 90 %" in text
    assert "growth" not in text
    assert "growth [1/s]" in _found(frequencies=[mode, {**mode, "omega": 0.0, "growth": 3.5}])


def test_the_poles_of_lowest_modulus_are_listed_and_the_others_counted() -> None:
    poles = [{"omega": float(k), "hz": k / 6.0, "growth": 0.0, "damping": 0.0} for k in range(1, 24)]
    found = {"states": ["a"] * 46, "inputs": ["push"], "outputs": ["tip.uy"], "poles": poles}
    lines = run_report({**FACTS, "state_space": found}, Units(), 2.0).split("\n")
    assert lines[-2].split()[:2] == ["20", "20"]
    assert lines[-1] == "3 more poles of greater modulus are in the result file and in --json"
    few = run_report({**FACTS, "state_space": {**found, "poles": poles[:20]}}, Units(), 2.0)
    assert few.split("\n")[-1].split()[:2] == ["20", "20"]


def test_limit_points_bifurcations_and_buckling_loads_are_listed() -> None:
    point = {"factor": 18544.527, "probes": {"load": {"ux": 26.8784, "uy": -48.7543, "theta": -0.5}}}
    critical = {"factor": 2.4674, "kind": "divergence", "omega": 0.0}
    text = _found(limit_points=[point], bifurcations=[{"factor": 77.5}], critical=[critical])
    for expected in ("18544.527", "load uy", "-48.7543", "77.5", "2.4674"):
        assert expected in text


def test_limit_points_and_expected_values_have_the_units_of_the_case() -> None:
    probe = {"ux": 1.0, "uy": 2.0, "theta": 0.5}
    summary = {**FACTS, "solver": "static", "iterations": 1, "steps": 1, "probes": {}, "reactions": {},
               "limit_points": [{"factor": 3.0, "probes": {"tip": probe}}],
               "checks": [{"what": "tip uy", "value": 1.0, "expected": 1.0, "difference": 0.0, "allowed": 0.1,
                           "met": True, "source": ""}]}
    text = run_report(summary, Units(length="mm"), 1.0)
    assert "tip ux [mm]  tip uy [mm]  tip theta [rad]" in text
    assert "tip uy [mm]  " in text.splitlines()[-1]


def test_the_column_of_times_has_a_fixed_width() -> None:
    """Two runs can then be compared line by line."""
    widths = {table([["n", TIME, "x"], ["2", duration(t), "y"]])[0].index("x")
              for t in (1e-5, 9.99e-4, 0.0144, 0.0521, 0.521, 1.0, 9.87, 118.0, 3000.0, 9e4)}
    assert len(widths) == 1


def test_times_near_a_change_of_unit_have_no_exponent() -> None:
    """A time that rounds to 1000 of a unit is 1 of the next."""
    assert [duration(t) for t in (9.996e-4, 0.9996, 119.9, 7199.0, 9e4)] == ["1 ms", "1 s", "120 s", "120 min", "25 h"]


def test_residuals_of_vanishing_values_are_zero() -> None:
    assert [number(v) for v in (-2.3e-145, 5e-324, 0.0, 1e-40, None)] == ["0", "0", "0", "1e-40", "-"]


def test_contacts_are_listed_with_resultant_and_zone_or_the_sum_of_pressing_forces() -> None:
    """Contact of a body with itself has no resultant; without contact there is no zone."""
    found = [{"name": "grip", "force": [0.3, 2.5], "normal": 2.5, "length": 0.5, "from": 0.25, "to": 0.5},
             {"name": "fold", "force": [0.0, 0.0], "normal": 3.5, "length": 0.1, "from": 0.2, "to": 0.7},
             {"name": "far", "force": [0.0, 0.0], "normal": 0.0, "length": 0.0, "from": None, "to": None}]
    lines = run_report({**FACTS, "contacts": found}, Units(), 1.0).split("\n")
    assert [line.split() for line in lines[-4:]] == [
        ["contact", "fx", "[N]", "fy", "[N]", "pressing", "[N]", "length", "[m]", "from", "S", "to", "S"],
        ["grip", "0.3", "2.5", "2.5", "0.5", "0.25", "0.5"], ["fold", "3.5", "0.1", "0.2", "0.7"],
        ["far", "0", "0", "0", "0"]]
