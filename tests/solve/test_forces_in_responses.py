"""Section forces in frequency responses, compared with closed forms, statics and the balance of a part of a body."""

from __future__ import annotations

import copy
import json
from typing import Any

import numpy as np
import pytest
from test_frequency_response import HZ, amplitude, cantilever, error

import ancf2d
from ancf2d.case import load_case_text
from ancf2d.errors import ComputationError
from ancf2d.model.build import build_model
from ancf2d.solvers.linear import coriolis_matrix, full_mass

INSIDE: dict[str, Any] = {
    "bodies": {"beam": {"geometry": {"type": "arc", "center": [0, 0], "radius": 1, "from": 0, "to": 1.5},
                        "section": {"height": 0.05, "width": 0.05}, "material": {"E": 2e9, "nu": 0.3, "rho": 1000},
                        "element": {"type": "reissner3", "count": 6, "nodes": "regular"}}},
    "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
    "springs": [{"type": "translational", "between": ["beam@0.37", [0, 0]], "stiffness": 2000, "damping": 3}],
    "masses": [{"at": "beam@0.71", "mass": 0.5}],
    "loads": [{"type": "force", "at": "beam@1", "value": [30, -20]},
              {"type": "follower_force", "at": "beam@0.55", "value": [5, 40]},
              {"type": "distributed", "on": "beam", "value": [0, -30], "follower": True},
              {"name": "line", "type": "distributed", "on": "beam", "value": ["-20*s", 7], "from": 0.2, "to": 0.9},
              {"name": "turn", "type": "moment", "at": "beam@0.45", "value": 3},
              {"name": "weight", "type": "gravity", "value": [1, -9.81]},
              {"name": "bend", "type": "eigenstrain", "on": "beam", "axial": 1e-4, "curvature": 0.01},
              {"name": "push", "type": "distributed", "on": "beam", "value": [2, 3], "follower": True}],
    "output": {"probes": {"a": "beam@0.31", "b": "beam@0.52", "c": "beam@0.02", "d": "beam@0.8"},
               "fields": ["N", "Q", "M"]}}


def root_forces(F: float = 0.0, base: float = 0.0, tau: float = 0.003) -> Any:
    """Return M = E w'' and Q = -dM/dx at the clamp (2, 200) of the closed form of ``exact``."""
    out = []
    for s in 2j * np.pi * HZ:
        E = 1 + tau * s
        waves = (-(s**2) / E)**0.25 * np.array([1, -1, 1j, -1j])
        tip = np.exp(waves)
        c = np.linalg.solve(np.array([np.ones(4), waves, waves**2 * tip, E * waves**3 * tip]), [base, 0, 0, -F])
        out.append([E * (c @ waves**2), -E * (c @ waves**3)])
    return np.array(out).T


@pytest.mark.parametrize(("element", "count"), [("cable", 48), pytest.param("reissner3", 160, marks=pytest.mark.slow)])
def test_section_forces_are_those_of_the_closed_form(element: str, count: int) -> None:
    """Single frequencies, and in a reduced space; with the viscous stress and the inertia of the element."""
    case = cantilever(["shaker", "base"], element, count)
    case["output"]["fields"] = ["N", "Q", "M"]
    found = ancf2d.solve(case)
    for name, size in (("shaker", {"F": 1.0}), ("base", {"base": 1.0})):
        M, Q = root_forces(**size)
        assert error(amplitude(found, name, "M", "root"), M) < 2e-4
        assert error(amplitude(found, name, "Q", "root"), Q) < 2e-4
        assert np.abs(amplitude(found, name, "N", "root")).max() < 1e-6 * np.abs(Q).max()


@pytest.mark.parametrize("element", ["reissner3", pytest.param("cable", marks=pytest.mark.slow)])
def test_section_forces_at_frequency_zero_are_derivatives_of_statics(element: str) -> None:
    """About a loaded state, with loads, a spring and a mass inside elements: against differences of equilibria."""
    names = ["line", "turn", "weight", "bend", "push"]
    case = copy.deepcopy(INSIDE)
    case["bodies"]["beam"]["element"]["type"] = element
    case["solver"] = {"type": "frequency_response", "frequencies": [0], "inputs": names, "about": "static"}
    response, h, ends = ancf2d.solve(case, states=False).summary["response"], 0.03, []
    found = {name: np.array([[response[name][p][q]["re"][0] for p in "abcd"] for q in ("N", "Q", "M")])
             for name in names}
    # all at once, so that each does as much as any other
    sizes = {name: np.abs(of).max() for name, of in found.items()}
    shares = {name: float(min(sizes.values()) / size) for name, size in sizes.items()}
    for factor in (h, -h):
        one = {**copy.deepcopy(case), "solver": {"type": "static", "tolerance": 1e-12, "steps": 2}}
        one["loads"] = [{**load, "amplitude": {"type": "expression", "value": f"{factor * shares[load['name']]}*t"}}
                        if "name" in load else load for load in one["loads"]]
        ends.append(ancf2d.solve(one, states=False).summary["probes"])
    for k, q in enumerate(("N", "Q", "M")):
        wanted = np.array([(ends[0][p][q] - ends[1][p][q]) / (2 * h) for p in "abcd"])
        parts = [shares[name] * found[name][k] for name in names]
        assert np.abs(sum(parts) - wanted).max() < 1e-6 * max(np.abs(part).max() for part in parts), q


@pytest.mark.slow
def test_section_forces_in_a_turning_frame_balance_inertia_and_coriolis_forces() -> None:
    """At the root of an undamped rotating cantilever, compared with the forces on all its coordinates."""
    spin, s = 6.0, 2j * np.pi * 1.3
    case = cantilever(["shaker"], "reissner3", 6, boundary_conditions=[{"type": "clamp", "at": "beam@0"}],
                      steady_rotation={"omega": spin})
    case["output"] = {"probes": {f"p{k}": f"beam@{k / 12!r}" for k in range(13)}, "fields": ["N", "Q", "M"]}
    case["solver"]["frequencies"] = [1.3]
    case["bodies"]["beam"]["section"] = {"EA": 300, "kGA": 300, "EI": 1, "rhoA": 1, "rhoI": 1e-3}
    case["bodies"]["beam"].pop("material")
    found = ancf2d.solve(case)
    model = build_model(load_case_text(json.dumps(case)))
    z, move = np.zeros(model.n_q, dtype=complex), np.zeros((2, model.n_q))
    for ie, dofs in enumerate(model.meshes["beam"].dofs):
        for node in range(3):
            probe = f"p{2 * ie + node}"
            z[dofs[3 * node:3 * node + 3]] = [amplitude(found, "shaker", q, probe)[0] for q in ("ux", "uy", "theta")]
            move[0, dofs[3 * node]] = move[1, dofs[3 * node + 1]] = 1.0
    M = full_mass(model)
    inertia = s * s * (M @ z) + s * (coriolis_matrix(model, spin) @ z) - spin**2 * (M @ z)
    N, Q = (amplitude(found, "shaker", q, "p0")[0] for q in ("N", "Q"))
    assert abs(N) > 1e-3 * abs(Q)
    np.testing.assert_allclose([N, Q], np.array([0, 1]) - move @ inertia, rtol=1e-6)


def test_section_forces_inside_an_element_with_a_support_are_refused() -> None:
    case = copy.deepcopy(INSIDE)
    case["boundary_conditions"].append({"type": "roller", "at": "beam@0.55", "fixed": "x"})
    case["solver"] = {"type": "frequency_response", "frequencies": [0, 1], "inputs": ["turn"]}
    with pytest.raises(ComputationError, match=r"N, Q and M of the probe b are not computed.*between the nodes"):
        ancf2d.solve(case, states=False)


def test_section_forces_at_a_clamp_of_whole_sections_are_refused_only_if_it_acts_beyond_its_node() -> None:
    """In 2d2n, the mean of a section depends on coordinates of the next node, too."""
    case = {"bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                "section": {"height": 0.1, "width": 0.1},
                                "material": {"E": 2e9, "nu": 0.3, "rho": 1000},
                                "element": {"type": "vallejo", "count": 4}}},
            "boundary_conditions": [{"type": "clamp", "at": "beam@0", "hold": "breathe"}],
            "loads": [{"name": "push", "type": "force", "at": "beam@1", "value": [2, -3], "spread": "uniform"}],
            "solver": {"type": "frequency_response", "frequencies": [0.0], "inputs": ["push"]},
            "output": {"probes": {"wall": "beam@0", "tip": "beam@1"}, "fields": ["N", "Q", "M"]}}
    found = ancf2d.solve(case, states=False).summary["response"]["push"]
    assert [found["wall"][q]["re"][0] for q in "NQM"] == pytest.approx([2.0, -3.0, -3.0], rel=1e-6)
    assert [found["tip"][q]["re"][0] for q in "NQM"] == pytest.approx([2.0, -3.0, 0.0], abs=1e-6)
    with pytest.raises(ComputationError, match=r"probe wall are not computed.*holds its element .* by a whole section"):
        ancf2d.solve(case, {"bodies.beam.element.type": "2d2n"}, states=False)
