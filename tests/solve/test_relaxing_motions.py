"""Small motions of materials that relax: modes, responses and linear models, against matrices and closed forms."""

from __future__ import annotations

import itertools
import math
from typing import Any

import helpers as h
import numpy as np
import pytest
from test_relaxation import LENGTH, PRONY, SIZE, TYPES, ZENER, E, complex_modulus, material, real_roots
from test_state_space import transfer

import ancf2d
from ancf2d.model.build import build_model
from ancf2d.model.points import dot, point_ref
from ancf2d.solvers.linear import full_mass
from ancf2d.solvers.small_motions.inputs_and_outputs import Inputs, outputs
from ancf2d.solvers.small_motions.linearised import Linearised, base_state
from ancf2d.solvers.small_motions.projected import Quadratic
from ancf2d.solvers.small_motions.relaxing import corrected

TERMS = {"zener": ZENER, "prony": PRONY}
SECTION = {"height": SIZE, "width": SIZE}


def scene(*bodies: Any, **more: Any) -> dict[str, Any]:
    """Return a chain of beams of these materials, clamped where ``base`` shakes it, with a load of each kind."""
    names = [f"b{k}" for k in range(len(bodies))]
    case: dict[str, Any] = {
        "bodies": {name: {"geometry": {"type": "line", "start": [k, 0], "end": [k + 1, 0]}, "section": SECTION,
                          "element": {"type": "reissner3", "count": 3}, "material": {**one, "alpha": 1e-4}}
                   for k, (name, one) in enumerate(zip(names, bodies, strict=True))},
        "joints": [{"type": "weld", "between": [f"{a}@1", f"{b}@0"]} for a, b in itertools.pairwise(names)],
        "boundary_conditions": [{"type": "prescribed", "at": "b0@0", "name": "base", "ux": 0, "uy": 1, "angle": 0}],
        "loads": [{"type": "force", "at": f"{names[-1]}@1", "value": [0.3, 1.0], "name": "push"},
                  {"type": "temperature", "on": "b0", "value": 10, "gradient": 500, "name": "heat"}],
        "output": {"probes": {"tip": f"{names[-1]}@1"}}}
    return {key: value for key, value in {**case, **more}.items() if value}


def solved(case: dict[str, Any], **solver: Any) -> Any:
    return ancf2d.solve(ancf2d.load({**case, "solver": solver}))


def responses(case: dict[str, Any], hz: list[float], inputs: list[str], about: str = "reference") -> np.ndarray:
    """Return the amplitudes (frequencies, inputs) of tip.uy."""
    found = solved(case, type="frequency_response", inputs=inputs, frequencies=hz, about=about).summary["response"]
    return np.array([np.array(found[name]["tip"]["uy"]["re"]) + 1j * np.array(found[name]["tip"]["uy"]["im"])
                     for name in inputs]).T


def linear_model(case: dict[str, Any], inputs: list[str], about: str) -> tuple[list[np.ndarray], Any]:
    done = solved(case, type="state_space", inputs=inputs, outputs=["tip.uy"], modes=6, about=about)
    return [done.arrays[f"state_space/{name}"] for name in "ABCD"], done


@pytest.mark.parametrize("terms", TERMS.values(), ids=TERMS)
def test_a_shaken_and_heated_beam_responds_with_the_complex_modulus(terms: tuple[tuple[float, float], ...]) -> None:
    """For one material, K -> K e(s): shaking is inertia in the moving frame, eigenstrains are e(s) times a force.

    M r is that of the rigid translation r, K and M those of the elastic beam.
    """
    hz, inputs = [0.05, 1.0, 2.5, 10.0, 40.0], ["base", "heat", "push"]
    found = responses(scene(material(terms)), hz, inputs)
    model = build_model(ancf2d.load({**scene(material(())), "solver": {
        "type": "frequency_response", "inputs": inputs, "frequencies": hz}}))
    small = Linearised(base_state(model, "reference"))
    K, M, num = small.K.toarray(), small.M.toarray(), model.numbering
    base, heat, push = Inputs(small)(inputs)
    tip = next(one for one in outputs(small) if one.quantity == "uy")
    rigid = expanded(model, np.linalg.solve(K, base.f[0])).real + base.p
    Mr = np.zeros(len(rigid))
    Mr[:model.n_q] = full_mass(model, model.e0) @ rigid[:model.n_q]
    for f, row in zip(hz, found, strict=True):
        s = 2j * np.pi * f
        e = complex_modulus(s, terms)
        forces = (-(s**2) * num.reduce(Mr), e * heat.f[0], push.f[0])
        exact = [tip.contributions(expanded(model, np.linalg.solve(e * K + s**2 * M, force)))[0] for force in forces]
        exact[0] += 1.0
        assert (np.abs(row / exact - 1.0) < 1e-7).all()


def test_a_range_of_frequencies_has_the_responses_of_each() -> None:
    case = scene(material(PRONY))
    found = solved(case, type="frequency_response", inputs=["push"], **{"from": 0.5, "to": 30.0}).summary["response"]
    hz, (re, im) = found["hz"], (np.array(found["push"]["tip"]["uy"][part]) for part in ("re", "im"))
    assert (hz[0], hz[-1], len(hz)) == (0.5, 30.0, len(set(hz)))
    np.testing.assert_allclose(re + 1j * im, responses(case, hz, ["push"])[:, 0], rtol=1e-9)


def expanded(model: Any, z: np.ndarray) -> np.ndarray:
    """Return the complex motion of all coordinates for unknowns z (n,)."""
    parts = np.zeros((2, len(model.numbering.place)))
    for part, one in zip(parts, (z.real, z.imag), strict=True):
        model.numbering.expand(np.ascontiguousarray(one), part)
    return parts[0] + 1j * parts[1]


RUBBERS = {"one": (material(ZENER),), "two": (material(PRONY[1:3]), {**material(((1.5, 0.05),)), "E": 3 * E}),
           "one of two": (material(()), material(PRONY[2:]))}
JET = {"type": "follower_force", "at": "b0@1", "value": [-0.002, 0.001], "name": "jet"}
DASHPOT = {"type": "translational", "between": ["b0@1", [1, 1]], "stiffness": 0.5, "damping": 0.02}


@pytest.mark.slow_rows("two-True")
@h.covering(kind=RUBBERS, jet=[False, True])
def test_a_linear_model_has_the_dashpots_among_its_states(kind: str, jet: bool) -> None:
    """Compared with the responses of all unknowns: the truncation shrinks with the modes, and vanishes at rest."""
    more = {"loads": [*scene(material(()))["loads"], JET]} if jet else {}
    case = scene(*RUBBERS[kind], springs=[DASHPOT], **more)
    if len(RUBBERS[kind]) == 2:
        case["loads"][0]["at"] = "b1@1"
    inputs, hz = ["push", "base", "heat"], [1e-4, 0.02, 0.5, 1.5]
    about = "static" if jet else "reference"
    wanted = responses(case, hz, inputs, about)
    system, done = linear_model(case, inputs, about)
    states = done.summary["state_space"]["states"]
    assert len(states) == len(set(states)) == len(system[0])
    assert states[-1].startswith("d")
    for f, row, allowed in zip(hz, wanted, (1e-6, 1e-5, 1e-3, 1e-2), strict=True):
        found = transfer(system, 2j * np.pi * f)[0]
        assert (np.abs(found - row) < allowed * np.abs(row)).all(), (f, found, row)
    assert (np.linalg.eigvals(system[0]).real < 0).all()


@pytest.mark.parametrize("kind", ["cable", "vallejo"])
def test_a_linear_model_follows_an_angle_prescribed_by_a_multiplier(kind: str) -> None:
    turned = {"type": "prescribed", "at": "b0@0", "name": "base", "ux": 0, "uy": 0, "angle": 0.3}
    spring = {"type": "translational", "between": ["b0@1", [1, 1]], "stiffness": 3 * E * SIZE**4 / 12}
    case = scene(material(PRONY), boundary_conditions=[turned], springs=[spring])
    case["bodies"]["b0"]["element"]["type"] = kind
    system, done = linear_model(case, ["base", "push"], "reference")
    assert done.model.numbering.n_multipliers == 1
    hz = [0.05, 2.5]
    for f, row in zip(hz, responses(case, hz, ["base", "push"]), strict=True):
        np.testing.assert_allclose(transfer(system, 2j * np.pi * f)[0], row, rtol=1e-4)


def test_free_bodies_relax_in_addition_to_rigid_motions() -> None:
    case = scene(material(ZENER), boundary_conditions=[])
    system, done = linear_model(case, ["push", "heat"], "reference")
    # three motions with two eigenvalues each, which round-off may make a pair of
    slow = [p for p in done.summary["state_space"]["poles"] if math.hypot(p["omega"], p["growth"]) < 1e-3]
    assert sum(2 if p["omega"] > 0 else 1 for p in slow) == 6
    hz = [0.5, 2.0, 6.0]
    for f, row in zip(hz, responses(case, hz, ["push", "heat"]), strict=True):
        assert (np.abs(transfer(system, 2j * np.pi * f)[0] - row) < 5e-3 * np.abs(row)).all()


@pytest.mark.slow_rows("one of two-jet")
@h.covering(kind=RUBBERS, with_=["nothing", "dashpot", "jet", "spin"])
def test_eigenvalues_solve_the_problem_of_all_unknowns(kind: str, with_: str) -> None:
    """det T(s) = 0: the smallest singular value of T(s) at each s, compared with that at 1.001 s."""
    more: dict[str, Any] = {"nothing": {}, "dashpot": {"springs": [DASHPOT]}, "jet": {},
                            "spin": {"steady_rotation": {"omega": 2.0}}}[with_]
    case = scene(*RUBBERS[kind], **more)
    case["loads"] = [JET] if with_ == "jet" else []
    case["boundary_conditions"] = [{"type": "clamp", "at": "b0@0"}]
    case = {key: value for key, value in case.items() if value}
    about = "static" if with_ == "jet" else "reference"
    done = solved(case, type="eigen", modes=3, about=about)
    found = [complex(f["growth"], f["omega"]) for f in done.summary["frequencies"]]
    assert sum(s.imag > 0 for s in found) == 3
    assert sum(s.imag == 0 for s in found) >= 3
    assert all(s.real < 0 for s in found)
    model = build_model(ancf2d.load({**case, "solver": {"type": "eigen", "about": about}}))
    problem = Quadratic(Linearised(base_state(model, "static" if with_ == "spin" else about)), relaxes=True)
    for s in found:
        least = [np.linalg.svd(problem.matrix(x).toarray() / np.outer(problem.weights, problem.weights),
                               compute_uv=False)[-1] for x in (s, 1.001 * s)]
        assert least[0] < 1e-5 * least[1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", TYPES, ids=lambda k: k[0])
def test_section_forces_are_those_of_the_complex_modulus(kind: tuple[str, str | None]) -> None:
    """At one frequency, E(i omega) is that of a Kelvin-Voigt material of modulus Re E and time Im E/(omega Re E).

    A bar that is held at both ends and heated slowly moves as an elastic one, and has E(i omega)/E of its N.
    """
    hz = 3.0
    e = complex_modulus(2j * np.pi * hz, PRONY)
    rubber = material(PRONY)
    voigt = {**material(()), "E": E * e.real, "damping": {"kelvin_voigt": e.imag / e.real / (2 * np.pi * hz)}}
    found = []
    for one in (rubber, voigt):
        case = scene(one, output={"probes": {"root": "b0@0", "inside": "b0@0.4"}, "fields": ["N", "Q", "M"]})
        case["bodies"]["b0"]["element"] = h.element(kind[0], 3, kind[1])
        done = solved(case, type="frequency_response", inputs=["base", "push"], frequencies=[hz])
        found.append(np.array([[complex(q["re"][0], q["im"][0]) for q in map(probe.get, ("N", "Q", "M"))]
                               for of in map(done.summary["response"].get, ("base", "push"))
                               for probe in map(of.get, ("root", "inside"))]))
    np.testing.assert_allclose(*found, rtol=0, atol=1e-6 * np.abs(found[0]).max())
    assert np.abs(found[0].imag).max() > 0.01 * np.abs(found[0]).max()
    held, slow = [], 0.01
    for one in (rubber, material(())):
        case = scene(one, output={"probes": {"inside": "b0@0.4"}, "fields": ["N", "Q", "M"]})
        case["bodies"]["b0"]["element"] = h.element(kind[0], 3, kind[1])
        case["boundary_conditions"] = [{"type": "clamp", "at": f"b0@{s}"} for s in (0, 1)]
        case["loads"] = [{"type": "temperature", "on": "b0", "value": 10, "name": "heat"}]
        response = solved(case, type="frequency_response", inputs=["heat"], frequencies=[slow]).summary["response"]
        held.append(complex(*(response["heat"]["inside"]["N"][part][0] for part in ("re", "im"))))
    assert abs(held[0] / (complex_modulus(2j * np.pi * slow, PRONY) * held[1]) - 1.0) < 1e-6


def test_no_eigenvalue_is_found_at_the_pole_of_the_stiffness() -> None:
    """At s = -1/tau, the pole of E(s), Newton's method ends without a result."""
    (_, tau), = ZENER
    model = build_model(h.load({"beam": {
        "geometry": h.line(1.0), "element": h.element("reissner3", 2), "material": material(ZENER),
        "section": {"height": SIZE, "width": SIZE}}}, "eigen", bc=[{"type": "clamp", "at": "beam@0"}]))
    problem = Quadratic(Linearised(base_state(model, "reference")), relaxes=True)
    assert corrected(problem, complex(-1.0 / tau), np.ones(problem.n, dtype=complex))[2] == 1.0


def test_a_free_relaxing_beam_has_three_rigid_modes() -> None:
    """With three requested, there is no other shape to relax."""
    found = ancf2d.solve(h.load({"beam": {
        "geometry": h.line(1.0), "element": h.element("reissner3", 2), "material": material(ZENER),
        "section": {"height": SIZE, "width": SIZE}}}, {"type": "eigen", "modes": 3}),
                         states=False).summary["frequencies"]
    assert [f["kind"] for f in found] == ["rigid"] * 3


@pytest.mark.parametrize("terms", [ZENER, PRONY, ((2.0, 1e-2), (0.1, 1e-3))], ids=["zener", "prony", "strong"])
def test_receptances_have_the_complex_modulus(terms: tuple[tuple[float, float], ...]) -> None:
    """For one material, H(omega) = sum_k phi_k^2/(omega_k^2 E(i omega)/E - omega^2) over its elastic modes."""
    shake = [{"type": "force", "at": "beam@1", "value": [0, 1.0], "name": "shaker"}]
    hz = [0.1, 1.0, 2.5, 10.0, 40.0]
    body = {"geometry": h.line(LENGTH), "element": h.element("cable", 2), "material": material(terms),
            "section": {"height": SIZE, "width": SIZE}}
    scene = {"bc": [{"type": "clamp", "at": "beam@0"}], "loads": shake, "output": {"probes": {"tip": "beam@1"}}}
    done = ancf2d.solve(h.load({"beam": body}, {"type": "frequency_response", "inputs": ["shaker"],
                                                "frequencies": hz}, **scene), states=False)
    found = done.summary["response"]["shaker"]["tip"]["uy"]
    elastic = {**body, "material": material(())}
    modes = ancf2d.solve(h.load({"beam": elastic}, {"type": "eigen", "modes": 8}, bc=scene["bc"]))
    model = build_model(h.load({"beam": elastic}, {"type": "eigen", "modes": 8}, bc=scene["bc"]))
    across = point_ref(model.meshes["beam"], 1.0).position()[1]
    phi = np.array([dot(across, shape) for shape in modes.arrays["modes/shapes"]])
    omega = np.array([f["omega"] for f in modes.summary["frequencies"]])
    for f, re, im in zip(hz, found["re"], found["im"], strict=True):
        w = 2 * np.pi * f
        exact = np.sum(phi**2 / (omega**2 * complex_modulus(1j * w, terms) - w**2))
        assert abs(complex(re, im) / exact - 1.0) < 1e-7


def test_modes_are_those_of_the_complex_modulus() -> None:
    """s^2 + omega^2 E(s)/E = 0 for each elastic omega: a pair, and a real root for each term."""
    body = {"geometry": h.line(LENGTH), "element": h.element("reissner3", 4), "material": material(PRONY),
            "section": {"height": SIZE, "width": SIZE}}
    found, elastic = (ancf2d.solve(h.load({"beam": {**body, "material": m}}, {"type": "eigen", "modes": 4},
                                          bc=[{"type": "clamp", "at": "beam@0"}]), states=False).summary["frequencies"]
                      for m in (material(PRONY), material(())))
    pairs = [f for f in found if f["omega"]]
    assert len(pairs) == 4
    for mode, free in zip(pairs, elastic, strict=True):
        s = complex(mode["growth"], mode["omega"])
        assert abs(s**2 + free["omega"] ** 2 * complex_modulus(s, PRONY)) < 1e-8 * abs(s) ** 2
    real = np.sort([f["growth"] for f in found if not f["omega"]])
    exact = np.sort(np.concatenate([real_roots(f["omega"], PRONY) for f in elastic]))
    np.testing.assert_allclose(real, exact, rtol=1e-8)
