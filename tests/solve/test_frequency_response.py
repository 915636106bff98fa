"""Frequency responses compared with closed forms of the Euler-Bernoulli beam, and with static solutions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import ancf2d

HZ = np.geomspace(0.05, 22.0, 100)  # four resonances
SECTION = {"EA": 1.0e7, "kGA": 1.0e7, "EI": 1, "rhoA": 1, "rhoI": 1.0e-7}


def cantilever(inputs: list[str], element: str = "cable", count: int = 48, **more: Any) -> dict[str, Any]:
    beam = {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]}, "section": SECTION,
            "material": {"damping": {"kelvin_voigt": 0.003}}, "element": {"type": element, "count": count}}
    base = {"type": "prescribed", "name": "base", "at": "beam@0", "ux": 0, "uy": 1, "angle": 0}
    return {"bodies": {"beam": beam}, "boundary_conditions": [base],
            "loads": [{"type": "force", "name": "shaker", "at": "beam@1", "value": [0, 1]}],
            "output": {"probes": {"tip": "beam@1", "root": "beam@0"}},
            "solver": {"type": "frequency_response", "frequencies": HZ.tolist(), "inputs": inputs}, **more}


def amplitude(solution: Any, name: str, quantity: str = "uy", probe: str = "tip") -> Any:
    found = solution.summary["response"][name][probe][quantity]
    return np.array(found["re"]) + 1j * np.array(found["im"])


def exact(F: float = 0.0, base: float = 0.0, turn: float = 0.0, tau: float = 0.003, alpha: float = 0.0,
          dashpot: float = 0.0) -> Any:
    """Return w(1) and w'(1) (2, frequencies) of E w'''' = -(s^2 + alpha s) w, E = 1 + tau s, clamped at what moves."""
    out = []
    for s in 2j * np.pi * HZ:
        E = 1 + tau * s
        k = (-(s**2 + alpha * s) / E)**0.25
        waves = k * np.array([1, -1, 1j, -1j])
        tip = np.exp(waves)
        rows = [np.ones(4), waves, waves**2 * tip, E * waves**3 * tip - dashpot * s * tip]
        c = np.linalg.solve(np.array(rows), [base, turn, 0, -F])
        out.append([c @ tip, c @ (waves * tip)])
    return np.array(out).T


def error(found: Any, known: Any) -> float:
    return float(np.max(np.abs(found / known - 1)))


@pytest.mark.parametrize("element", [pytest.param("cable", marks=pytest.mark.slow), "reissner3"])
def test_receptance_and_base_excitation_are_those_of_the_closed_form(element: str) -> None:
    found = ancf2d.solve(cantilever(["shaker", "base"], element))
    w, slope = exact(F=1)
    assert error(amplitude(found, "shaker"), w) < 1e-4
    assert error(amplitude(found, "shaker", "theta"), slope) < 1e-4
    assert error(amplitude(found, "shaker", "vy"), 2j * np.pi * HZ * w) < 1e-4
    assert error(amplitude(found, "base"), exact(base=1)[0]) < 1e-4
    assert amplitude(found, "base", probe="root") == pytest.approx(np.ones(len(HZ)))


@pytest.fixture
def count(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Count the sizes of matrices that frequency responses factor."""
    from ancf2d.solvers.small_motions import factors, frequency_response

    found: list[Any] = []

    class Counted(factors.Factors):
        def __init__(self, A: Any) -> None:
            found.append(A.shape)
            super().__init__(A)

    monkeypatch.setattr(frequency_response, "Factors", Counted)
    return found


def test_many_frequencies_of_a_fine_mesh_need_few_factorisations(count: list[Any]) -> None:
    """Compared with single frequencies, and the closed form; round-off of the assembled stiffness has no effect."""
    damper = {"type": "translational", "between": ["beam@1", [1, 1.0e6]], "stiffness": 0, "damping": 0.3}
    more = {"springs": [damper], "damping": {"rayleigh": {"alpha": 0.1, "beta": 0}}}
    found = ancf2d.solve(cantilever(["shaker", "base"], "reissner3", 150, **more))
    assert len(count) <= 30
    known = {"shaker": exact(F=1, alpha=0.1, dashpot=0.3)[0], "base": exact(base=1, alpha=0.1, dashpot=0.3)[0]}
    few = cantilever(["shaker", "base"], "reissner3", 150, **more)
    few["solver"]["frequencies"] = HZ[::10].tolist()
    each = ancf2d.solve(few)
    assert 0.0 < found.summary["response_error"] < 1e-7
    assert each.summary["response_error"] is None
    for name in ("shaker", "base"):
        assert error(amplitude(found, name)[::10], amplitude(each, name)) < 1e-6
        assert error(amplitude(found, name), known[name]) < 2e-4


@pytest.mark.slow
def test_models_with_multipliers_need_few_factorisations_too(count: list[Any]) -> None:
    """A support that rotates the end of a cable, and a slider with a mass: compared with single frequencies."""
    case = cantilever(["shaker", "turn"], count=120)
    case["bodies"]["slider"] = {"geometry": {"type": "line", "start": [0.73, 0], "end": [0.73, 1]},
                                "element": {"type": "rigid", "mass": 0.1, "inertia": 0.01}}
    case["joints"] = [{"type": "prismatic", "on": "beam", "point": "slider@0"}]
    case["boundary_conditions"] = [{"type": "pin", "at": "beam@0"},
                                   {"type": "prescribed", "name": "turn", "at": "beam@0", "angle": 2},
                                   {"type": "roller", "at": "slider@0", "fixed": "x"},
                                   {"type": "roller", "at": "slider@1", "fixed": "x"}]
    few = {**case, "solver": {**case["solver"], "frequencies": HZ[::25].tolist()}}
    found = ancf2d.solve(case)
    assert len(count) <= 40
    each = ancf2d.solve(few)
    assert found.summary["response_error"] is not None
    assert each.summary["response_error"] is None
    for name in ("shaker", "turn"):
        for quantity in ("uy", "theta"):
            assert error(amplitude(found, name, quantity)[::25], amplitude(each, name, quantity)) < 1e-6


def over_a_range(tau: float, points: int, **more: Any) -> dict[str, Any]:
    solver = {"type": "frequency_response", "from": HZ[0], "to": HZ[-1], "points": points, "inputs": ["shaker", "base"]}
    case = cantilever([], solver={**solver, **more.pop("solver", {})}, **more)
    case["bodies"]["beam"]["material"]["damping"]["kelvin_voigt"] = tau
    return case


@pytest.mark.slow_rows("0.003-400")
@pytest.mark.parametrize(("tau", "points"), [(3e-3, 400), (1e-5, 5)])
def test_points_are_dense_where_responses_curve(tau: float, points: int) -> None:
    """The sharpest of the four resonances have a width of 2e-5 of their frequency: five points alone miss them."""
    found = ancf2d.solve(over_a_range(tau, points))
    hz = np.array(found.summary["response"]["hz"])
    grid = np.geomspace(HZ[0], HZ[-1], points)
    assert np.abs(hz[:, None] / grid - 1).min(axis=0).max() < 1e-12
    assert points < len(hz) < points + 600
    H = np.abs(amplitude(found, "shaker"))
    for first in (1.8751, 4.6941, 7.8548, 10.9955):
        # at a resonance the closed form is the static share of its mode, 4/omega^2, over twice the damping ratio
        omega, zeta = first**2, 0.5 * tau * first**2
        near = np.abs(hz - omega / (2 * np.pi)) < 0.02 * hz
        if zeta < 0.005:
            assert H[near].max() == pytest.approx(4 / omega**2 / (2 * zeta), rel=0.01)


def test_circles_of_resonances_are_drawn_round() -> None:
    """Straight lines between points at which cubics give the response to 1e-3 would turn by half a radian."""
    case = over_a_range(1e-4, 5, count=6)
    case["solver"]["to"] = 1.0
    (plane,) = ancf2d.solve(case).plot("nyquist", input="shaker", quantity="uy", probe="tip").axes
    H = plane.lines[0].get_xdata() + 1j * plane.lines[0].get_ydata()
    H = H[np.abs(H) > 0.3 * np.abs(H).max()]
    turns = np.abs(np.angle(np.diff(H)[1:] / np.diff(H)[:-1]))
    assert turns.max() < 0.2
    # the circle of one mode through 0: H = static share/(1 - r^2 + 2 i zeta r)
    radius = 0.5 * np.abs(H).max()
    assert np.abs(H + 1j * radius) == pytest.approx(radius, rel=0.01)


def test_points_of_undamped_responses_are_limited() -> None:
    case = over_a_range(0.0, 20, count=12)
    del case["bodies"]["beam"]["material"]
    assert 20 < len(ancf2d.solve(case, states=False).summary["response"]["hz"]) < 1000


@pytest.mark.parametrize("solver", [{}, pytest.param(
    {"from": None, "to": None, "points": None, "frequencies": HZ[::4].tolist()}, marks=pytest.mark.slow)])
def test_responses_to_an_accuracy(solver: dict[str, Any]) -> None:
    """The error of all curves is reported; it agrees with the closed form, also between the points."""
    from ancf2d.study.accuracy.control import solve_to_accuracy
    from ancf2d.study.goal import curves_of

    case = over_a_range(1e-3, 40, solver=solver, count=4, accuracy=1e-3)
    case["solver"] = {k: v for k, v in case["solver"].items() if v is not None}
    reached = solve_to_accuracy(ancf2d.load(case))
    told = reached.accuracy
    assert told["achieved"]
    assert told["value"] is None
    assert told["estimate"] <= 1e-3
    curves = curves_of(None, reached.outcome.summary["response"], True)
    w, slope = exact(F=1, tau=1e-3)
    for k, known in ((1, w), (2, slope)):
        between = slice(None, None, 1 if "from" in case["solver"] else 4)
        off = np.abs(curves.at(HZ[between])[:, k] - known[between]) / curves.sizes[k]
        assert off.max() < told["estimate"]


def test_a_largest_amplitude_converges_with_the_mesh() -> None:
    """The points of a range, which differ between meshes, have no effect on the error of a study."""
    goal = {"input": "shaker", "probe": "tip", "quantity": "uy"}
    study = ancf2d.convergence(over_a_range(3e-3, 40, goal=goal), elements=[4, 8, 16])
    assert study.as_json()["extrapolated"] == pytest.approx(30.675725, rel=1e-5)


def test_dashpots_and_rayleigh_damping_act() -> None:
    damper = {"type": "translational", "between": ["beam@1", [1, 1.0e6]], "stiffness": 0, "damping": 0.3}
    case = cantilever(["shaker", "base"], springs=[damper], damping={"rayleigh": {"alpha": 0.7, "beta": 0.001}})
    found = ancf2d.solve(case)
    more = {"tau": 0.004, "alpha": 0.7, "dashpot": 0.3}
    assert error(amplitude(found, "shaker"), exact(F=1, **more)[0]) < 1e-4
    assert error(amplitude(found, "base"), exact(base=1, **more)[0]) < 1e-4


def test_line_loads_and_gravity_are_inputs() -> None:
    """The closed form of E w'''' = -s^2 w + q: q/s^2 and four exponentials that satisfy the conditions at both ends."""
    loads = [{"type": "distributed", "name": "line", "on": "beam", "value": [0, 2]},
             {"type": "distributed", "name": "part", "on": "beam", "value": [0, 2], "from": 0.25, "to": 0.75},
             {"type": "distributed", "name": "rest", "on": "beam", "value": [0, 2], "to": 0.25},
             {"type": "distributed", "name": "end", "on": "beam", "value": [0, 2], "from": 0.75},
             {"type": "gravity", "name": "weight", "value": [0, -9.81]}]
    case = cantilever([load["name"] for load in loads], loads=loads)
    case["solver"]["frequencies"] = HZ[::20].tolist()
    found = ancf2d.solve(case)
    known = []
    for s in 2j * np.pi * HZ[::20]:
        k = (-s**2 / (1 + 0.003 * s))**0.25 * np.array([1, -1, 1j, -1j])
        tip = np.exp(k)
        c = np.linalg.solve(np.array([np.ones(4), k, k**2 * tip, k**3 * tip]), [-1 / s**2, 0, 0, 0])
        known.append(1 / s**2 + c @ tip)
    assert error(amplitude(found, "line"), 2 * np.array(known)) < 1e-4
    assert error(amplitude(found, "weight"), -9.81 * np.array(known)) < 1e-4
    parts = sum(amplitude(found, name) for name in ("part", "rest", "end"))
    assert error(parts, amplitude(found, "line")) < 1e-9


@pytest.mark.slow_rows("cable")
@pytest.mark.parametrize("element", ["cable", "reissner3"])
def test_a_prescribed_angle_is_an_input(element: str) -> None:
    """With a multiplier (cable) and without (reissner3), about an equilibrium with a moment in the support."""
    case = cantilever(["base"], element)
    case["boundary_conditions"][0].update(uy=0, angle=2)
    assert error(amplitude(ancf2d.solve(case), "base"), exact(turn=2)[0]) < 1e-4


@pytest.mark.slow
def test_at_frequency_0_the_response_is_the_derivative_of_the_equilibrium() -> None:
    """About a large static deflection, with a follower load, a moving and a rotating support."""
    still = {"type": "static", "tolerance": 1e-12}

    def case(solver: dict[str, Any], push: float = 0.0, lift: float = 0.0, turn: float = 0.0) -> dict[str, Any]:
        weight = {"type": "force", "at": "beam@1", "value": [-0.5, -3]}
        other = {"type": "follower_force", "name": "push", "at": "beam@0.6", "value": [0.4 * push, push]}
        bases = [{"type": "prescribed", "name": "lift", "at": "beam@0", "ux": 0, "uy": lift},
                 {"type": "prescribed", "name": "turn", "at": "beam@0", "angle": turn}]
        return cantilever([], "cable", 8, boundary_conditions=bases, loads=[weight, other]) | {"solver": solver}

    names = ("push", "lift", "turn")
    solver = {"type": "frequency_response", "frequencies": [0], "inputs": list(names), "about": "static"}
    found = ancf2d.solve(case(solver, 1, 1, 1))
    for name in names:
        h = 1e-4
        up, down = (ancf2d.solve(case(still, **{name: x}), states=False).summary["probes"]["tip"] for x in (h, -h))
        for q in ("ux", "uy", "theta"):
            assert amplitude(found, name, q)[0] == pytest.approx((up[q] - down[q]) / (2 * h), rel=1e-5, abs=1e-6)


def test_amplitudes_over_time_are_ignored() -> None:
    sine = {"type": "sine", "frequency": 3, "scale": 0.5}
    case = cantilever(["shaker", "base"], count=4)
    case["loads"][0].update(amplitude={"type": "sine", "frequency": 2})
    case["boundary_conditions"][0].update(uy=sine)
    plain = ancf2d.solve(cantilever(["shaker", "base"], count=4))
    found = ancf2d.solve(case)
    assert amplitude(found, "shaker") == pytest.approx(amplitude(plain, "shaker"), rel=1e-12)
    assert amplitude(found, "base") == pytest.approx(0.5 * amplitude(plain, "base"), rel=1e-12)


@pytest.mark.parametrize(("solver", "told"), [
    ({"inputs": ["shakr"]}, "did you mean 'shaker'"),
    ({"inputs": ["shaker", "shaker"]}, "named twice"),
    ({"frequencies": None}, "the frequencies are missing"),
    ({"frequencies": None, "from": 5, "to": 2}, "from must be less than to"),
    ({"from": 5, "to": 20}, "both given"),
])
def test_wrong_inputs_and_frequencies_are_reported(solver: dict[str, Any], told: str) -> None:
    case = cantilever(["shaker"], count=4)
    case["solver"] = {k: v for k, v in {**case["solver"], **solver}.items() if v is not None}
    with pytest.raises(ancf2d.CaseError) as caught:
        ancf2d.solve(case, states=False)
    assert told in str(caught.value)


def test_range_of_frequencies() -> None:
    case = cantilever(["shaker"], count=4)
    for scale, known in (("log", [1, 10, 100]), ("linear", [1, 50.5, 100])):
        case["solver"] = {"type": "frequency_response", "from": 1, "to": 100, "points": 3, "scale": scale,
                          "inputs": ["shaker"]}
        hz = np.array(ancf2d.solve(case, states=False).summary["response"]["hz"])
        assert (np.diff(hz) > 0).all()
        assert hz[[0, -1]] == pytest.approx([1, 100], rel=1e-14)
        assert np.abs(hz - known[1]).min() < 1e-12


def test_other_loads_are_reported_to_have_no_effect() -> None:
    case = cantilever(["shaker"], count=2)
    case["loads"].append({"name": "other", "type": "force", "at": "beam@0.5", "value": [0, 1]})
    told = ancf2d.solve(case, states=False).warnings
    assert any("loads and prescribed motions other than inputs have no effect" in w for w in told)


def test_an_undamped_free_body_has_no_response_at_frequency_0() -> None:
    case = cantilever(["shaker"], count=4, boundary_conditions=[])
    case["solver"]["frequencies"] = [0]
    with pytest.raises(ancf2d.CaseError, match="free to"):
        ancf2d.solve(case, states=False)


@pytest.mark.slow
def test_figures_tables_and_comparison(tmp_path: Any) -> None:
    """The file holds the data of the summary: figures, CSV and ``compare`` read it."""
    from ancf2d.results.compare import compare_results
    from ancf2d.results.export import export
    from ancf2d.results.target import is_own

    case = cantilever(["shaker", "base"], count=4)
    file, other = tmp_path / "a.h5", tmp_path / "b.h5"
    found = ancf2d.solve(case, output=file)
    above, below = found.plot("bode", input="shaker", quantity="uy", probe="tip").axes
    H = amplitude(found, "shaker")
    assert above.lines[0].get_ydata() == pytest.approx(np.abs(H))
    assert np.cos(np.radians(below.lines[0].get_ydata())) == pytest.approx(np.cos(np.angle(H)))
    (plane,) = found.plot("nyquist", input="base", quantity="uy", probe="tip").axes
    assert plane.lines[0].get_xdata() == pytest.approx(amplitude(found, "base").real)
    table = tmp_path / "a.csv"
    export(file, table)
    names, *rows = (line.split(",") for line in table.read_text().splitlines())
    assert names[0] == "hz"
    assert float(rows[7][names.index("shaker.tip.uy.im")]) == H[7].imag
    assert is_own(table)
    case["loads"][0]["value"] = [0, 1.01]
    ancf2d.solve(case, output=other)
    assert {d.dataset for d in compare_results(file, other)} >= {"/tables/response/shaker.tip.uy.re"}
    with ancf2d.open_results(file) as results:
        assert results.tables["response"].units["shaker.tip.vy.im"] == "m/s"


def test_probes_without_motion_are_drawn_by_their_section_forces() -> None:
    case = cantilever(["shaker"], count=2)
    case["output"] = {"probes": {"root": "beam@0"}, "fields": ["N", "Q", "M"]}
    found = ancf2d.solve(ancf2d.load(case))
    assert [a.get_ylabel().split(" [")[0] for a in found.plot("bode").axes] == [
        "amplitude of shear force", "amplitude of bending moment", "phase"]
    # zero has no place on a logarithmic axis
    assert found.plot("bode", quantity="ux").axes[0].get_yscale() == "linear"
