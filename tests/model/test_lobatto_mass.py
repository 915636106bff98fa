"""A share of the mass by Gauss-Lobatto points: more accurate wave speeds, the same mass and inertia."""

from __future__ import annotations

import json

import numpy as np
import pytest

from ancf2d.case import DefinitionNode, ElementDefinition, load_case_text
from ancf2d.elements.shape import lobatto
from ancf2d.model.build import build_model
from ancf2d.model.classes import mass_matrix
from ancf2d.model.own_element import element_issues
from ancf2d.solvers.registry import solve
from ancf2d.study.run import vocabulary

L, E, RHO = 2.0, 1.0, 1.0


def definition(p: int, share: float, kind: str = "theta") -> dict:
    """Return an element of degree p along the axis with nodes at the Gauss-Lobatto points."""
    if kind == "theta":
        basis, coordinates = [f"x^{k}" if k else "1" for k in range(p + 1)], ["r", "theta"]
    else:
        basis = [f"x^{k}*y^{m}" for m in range(2) for k in range(p + 1)]
        coordinates = ["r", "r_y"]
    return {"name": "mine", "basis": basis, "lobatto": share,
            "nodes": [{"at": float(x), "coordinates": coordinates} for x in lobatto(p + 1)[0]]}


def model(tmp_path, count: int, spec: dict, **more):
    (tmp_path / "mine.yaml").write_text(json.dumps(spec))
    case = {"bodies": {"bar": {"geometry": {"type": "line", "start": [0, 0], "end": [L, 0]},
                               "section": {"height": 0.1, "width": 0.1}, "material": {"E": E, "nu": 0.0, "rho": RHO},
                               "element": {"definition": "mine.yaml", "count": count}}},
            "solver": {"type": "eigen", "modes": 3}, **more}
    return build_model(load_case_text(json.dumps(case), vocabulary=vocabulary(), directory=str(tmp_path)))


def third_axial_error(tmp_path, count: int, p: int, share: float) -> float:
    """Return the relative error of the third axial frequency of a bar fixed at both ends."""
    held = [{"type": "roller", "at": "bar@0", "fixed": "x"}, {"type": "roller", "at": "bar@1", "fixed": "x"}]
    bar = model(tmp_path, count, definition(p, share), boundary_conditions=held)
    from ancf2d.solvers.small_motions.lowest_modes import Pencil

    pencil = Pencil(bar, np.zeros(len(bar.numbering.place)), 0.0, True).with_mass()
    along = np.flatnonzero(np.isin(bar.numbering.free, np.flatnonzero(bar.meshes["bar"].kinds >= 0)[::3]))
    K, M = (np.column_stack([f(x) for x in np.eye(pencil.n)])[np.ix_(along, along)]
            for f in (pencil.apply_K, pencil.apply_B))
    import scipy.linalg

    omega = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True)[2])
    return abs(omega * L / (3 * np.pi) - 1.0)


@pytest.mark.parametrize(("p", "counts"), [(2, (8, 16)), (3, (6, 12)), (4, (4, 8))])
def test_waves_along_a_bar_gain_two_orders(tmp_path, p, counts):
    """Frequencies are off by h^(2 p) with the exact mass, by h^(2 p + 2) with p/(p + 1) (Ainsworth & Wajid 2010)."""
    for share, order in ((0.0, 2 * p), (p / (p + 1), 2 * p + 2)):
        a, b = (third_axial_error(tmp_path, n, p, share) for n in counts)
        assert abs(np.log2(a / b) - order) < 0.35, share


@pytest.mark.parametrize("kind", ["theta", "r_y"])
@pytest.mark.parametrize("p", [2, 3, 4])
def test_rigid_motions_have_the_same_energy(tmp_path, p, kind):
    """Translations and rotations are linear along the axis, so their energy is quadratic."""
    masses = []
    for share in (0.0, 0.5, 1.0):
        bar = model(tmp_path, 1, definition(p, share, kind))
        mesh = bar.meshes["bar"]
        M, nc = mass_matrix(mesh.classes[0].sampler), mesh.plan.element.components
        e0 = mesh.e0[mesh.dofs[0]]
        turn = np.zeros_like(e0)
        turn[0::nc], turn[1::nc] = -e0[1::nc], e0[0::nc]
        shift = np.zeros_like(e0)
        names = [name for _, name in mesh.plan.element.functionals]
        for k, name in enumerate(names):
            shift[nc * k] = name == "r"
        if nc == 3:
            turn[2::3] = 1.0
        masses.append([shift @ M @ shift, turn @ M @ turn, shift @ M @ turn])
    np.testing.assert_allclose(masses[1:], [masses[0]] * 2, rtol=1e-12, atol=1e-14)
    assert masses[0][0] == pytest.approx(RHO * 0.01 * L)


def test_the_whole_mass_at_lobatto_nodes_is_diagonal(tmp_path):
    bar = model(tmp_path, 1, definition(4, 1.0))
    M = mass_matrix(bar.meshes["bar"].classes[0].sampler)
    np.testing.assert_allclose(M, np.diag(np.diag(M)), atol=1e-16)


def test_two_points_would_increase_the_inertia_of_a_rotating_bar():
    spec = ElementDefinition("mine", ("1", "x"), tuple(DefinitionNode(at, ("r", "theta")) for at in (0.0, 1.0)),
                             lobatto=0.5)
    (issue,) = element_issues(spec)
    assert "overestimate the rotary inertia" in issue.message


@pytest.mark.slow
def test_motions_conserve_energy_with_a_blended_mass(tmp_path):
    solver = {"type": "dynamic", "t_end": 0.5, "dt": 0.005, "method": "radau9", "estimate": False}
    bar = model(tmp_path, 4, definition(3, 0.75), solver=solver,
                boundary_conditions=[{"type": "pin", "at": "bar@0"}], loads=[{"type": "gravity", "value": [0, -9.81]}])
    *_, last = solve(bar)
    assert last.report["energy_drift"] < 1e-7
