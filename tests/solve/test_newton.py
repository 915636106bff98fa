"""Newton's method and load steps: order of convergence, cut steps, limit points, any units and scales."""

from itertools import pairwise

import helpers
import numpy as np
import pytest

from ancf2d.errors import ComputationError
from ancf2d.solvers.statics.newton import TOLERANCE, has_converged
from ancf2d.solvers.statics.static import solve_static
from ancf2d.solvers.system import System

STEEL_EI = 2.07e11 * 0.1**4 / 12


def beam(name: str, formulation: str | None = None, count: int = 8):
    return {
        "beam": helpers.body(
            helpers.line(2.0), helpers.element(name, count, formulation), {"height": 0.1, "width": 0.1}, helpers.STEEL
        )
    }


CLAMP = [{"name": "w", "type": "clamp", "at": "beam@0"}]


@helpers.every_small_variant
def test_newton_converges_quadratically(name, formulation):
    loads = [
        *helpers.tip(0.0, -0.3 * STEEL_EI),
        {"type": "moment", "at": "beam@1", "value": 0.1 * STEEL_EI},
        {"type": "follower_force", "at": "beam@0.5", "value": [0.0, 0.1 * STEEL_EI]},
    ]
    model = helpers.build(beam(name, formulation), bc=CLAMP, loads=loads)
    system = System(model)
    steps = increments(system, 12)
    size = max(steps)
    # a tangent that is off by 1e-3 of itself could not reduce an increment further than by that
    assert min(b / a for a, b in pairwise(steps) if a > 1e-9 * size) < 1e-3
    assert min(steps[:10]) < 1e-13 * size


def increments(system, most: int) -> list[float]:
    """Return the increments of full Newton steps from the reference at the full load."""
    model = system.model
    d = np.zeros(len(model.numbering.place))
    out = []
    for _ in range(most):
        balance = system.assemble(d, 1.0)
        system.factor({})
        z = -system.matrix.solve(balance.R)
        d = model.displacements(d[model.numbering.free] + z, 1.0)
        out.append(system.norm(z))
    return out


def test_a_state_keeps_its_forces_while_the_next_one_is_found():
    model = helpers.build(beam("vallejo"), bc=CLAMP, loads=helpers.tip(0.0, -STEEL_EI))
    system, seen = System(model), []
    for state in solve_static(model, 4):
        seen.append((state, state.d.copy(), state.Q.copy()))
    for state, d, Q in seen:
        np.testing.assert_array_equal(state.d, d)
        np.testing.assert_array_equal(state.Q, Q)
        np.testing.assert_array_equal(Q, system.forces(d, state.t).Q)


@helpers.covering({"name": helpers.FEW_TYPES}, name=helpers.SMALL_TYPES, tolerance=[1e-2, 1e-6, TOLERANCE])
def test_every_state_is_in_equilibrium_and_as_close_as_the_tolerance_asks(name, tolerance):
    P = STEEL_EI
    out = helpers.solved(
        beam(name), {"type": "static", "steps": 3, "tolerance": tolerance}, bc=CLAMP, loads=helpers.tip(0, -P)
    )
    system = System(out.model)
    for state in out.states:
        # reduced forces per unit of displacement, so that gradients count like positions
        R = system.forces(state.d, state.t).R / np.where(system.weights > 0, system.weights, 1.0)
        assert np.abs(R).max() < 1e-5 * P
    tight = helpers.solved(
        beam(name), {"type": "static", "steps": 3, "tolerance": 1e-13}, bc=CLAMP, loads=helpers.tip(0, -P)
    )
    np.testing.assert_allclose(out.u("beam@1"), tight.u("beam@1"), atol=max(tolerance, 1e-9))
    assert out.iterations <= tight.iterations


@pytest.mark.parametrize(
    ("increments", "converged"),
    [([1e-12], False), ([1e-3, 1e-7], True), ([1e-3, 1e-5], False), ([1e-10, 0.9e-10], False), ([1.0, 0.0], True)],
)
def test_convergence_is_judged_by_the_predicted_next_increment(increments, converged):
    """A second increment smaller by c predicts a third smaller by c again; that one must be below 1e-9 of the size."""
    assert has_converged(increments, 1.0, 1e-9) == converged


@helpers.every_small_type
def test_a_load_too_large_for_one_step_is_divided_and_reaches_the_same_state(name):
    loads = helpers.tip(0.0, -6 * STEEL_EI)
    one = helpers.solved(beam(name), {"type": "static", "steps": 1}, bc=CLAMP, loads=loads)
    many = helpers.solved(beam(name), {"type": "static", "steps": 40}, bc=CLAMP, loads=loads)
    np.testing.assert_allclose(one.u("beam@1"), many.u("beam@1"), rtol=1e-7)
    assert one.state.t == many.state.t == 1.0
    assert len(many.states) >= 40


def test_cutting_back_is_recorded():
    loads = helpers.tip(0.0, -30 * STEEL_EI)
    out = helpers.solved(beam("kerkkanen"), {"type": "static", "steps": 1, "max_iterations": 8}, bc=CLAMP, loads=loads)
    assert sum(s.history["cutbacks"] for s in out.states) > 0
    assert all(s.history["iterations"] <= 8 for s in out.states)


@pytest.mark.parametrize("steps", [1, 3, 10])
def test_no_load_step_is_larger_than_requested(steps):
    out = helpers.solved(
        beam("cable"), {"type": "static", "steps": steps}, bc=CLAMP, loads=helpers.tip(0.0, -0.1 * STEEL_EI)
    )
    factors = [0.0, *(s.t for s in out.states)]
    assert np.diff(factors).max() <= 1 / steps + 1e-12
    assert factors[-1] == 1.0
    assert len(out.states) == steps


def test_the_load_factor_may_end_at_values_other_than_one():
    half = helpers.solved(
        beam("cable"), {"type": "static", "until": {"load_factor": 0.5}}, bc=CLAMP, loads=helpers.tip(0.0, -STEEL_EI)
    )
    whole = helpers.solved(beam("cable"), bc=CLAMP, loads=helpers.tip(0.0, -0.5 * STEEL_EI))
    assert half.state.t == pytest.approx(0.5)
    np.testing.assert_allclose(half.u("beam@1"), whole.u("beam@1"), rtol=1e-8)


def shallow_arch(name: str, P: float):
    arch = {
        "a": helpers.body(
            {"type": "arc", "center": [0, -10], "radius": 10.0, "from": np.pi / 2 + 0.25, "to": np.pi / 2 - 0.25},
            helpers.element(name, 16),
            {"height": 0.1, "width": 0.1},
            helpers.STEEL,
        )
    }
    bc = [{"type": "pin", "at": "a@0"}, {"type": "pin", "at": "a@1"}]
    return helpers.solved(arch, bc=bc, loads=[{"type": "force", "at": "a@0.5", "value": [0.0, -P]}])


@pytest.mark.slow_rows("vallejo")
@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner3"])
def test_snap_through_is_refused_with_the_reached_load_and_advice(name):
    below = shallow_arch(name, 0.5e5)
    assert below.u("a@0.5")[1] < 0
    with pytest.raises(ComputationError, match="no equilibrium was found beyond load factor") as error:
        shallow_arch(name, 1e7)
    assert "arc_length" in error.value.failure.advice
    reached = float(error.value.failure.reason.split("load factor ")[1].split(":")[0])
    assert 0 < reached < 1
    # on the branch: the same arch carries just that load, and not a tenth more
    shallow_arch(name, 0.99 * reached * 1e7)
    with pytest.raises(ComputationError):
        shallow_arch(name, 1.1 * reached * 1e7)


@helpers.covering({"name": helpers.FEW_TYPES}, name=helpers.SMALL_TYPES, factor=[1e-6, 1e-12, 1e-20])
def test_tiny_loads_give_tiny_displacements_in_proportion(name, factor):
    P = 1000.0 * factor
    nonlinear = helpers.solved(beam(name), bc=CLAMP, loads=helpers.tip(0.0, -P))
    linear = helpers.solved(beam(name), "linear_static", bc=CLAMP, loads=helpers.tip(0.0, -1000.0))
    assert nonlinear.u("beam@1")[1] / factor == pytest.approx(linear.u("beam@1")[1], rel=1e-6)
    assert nonlinear.reactions()["w"]["fy"] == pytest.approx(P, rel=1e-6)


@helpers.covering({"name": helpers.FEW_TYPES}, name=helpers.TYPES, solver=["linear_static", "static"])
def test_no_load_is_no_displacement_exactly(name, solver):
    bodies = {"beam": helpers.body(helpers.ARC, helpers.element(name, 3))}
    out = helpers.solved(bodies, solver, bc=CLAMP)
    assert not out.d.any()
    assert out.state.energy == 0.0
    assert all(v == 0.0 for v in out.reactions()["w"].values())


@helpers.covering({"variant": helpers.FEW_VARIANTS}, variant=helpers.SMALL_VARIANTS, solver=["linear_static", "static"])
def test_answers_do_not_depend_on_units(name, formulation, solver):
    """Metres, millimetres, kilometres; newtons and meganewtons."""

    def tip(length: float, force: float):
        arc = {"type": "arc", "center": [0, 0], "radius": 2 * length, "from": 0.3, "to": 1.3}
        bodies = {
            "beam": helpers.body(
                arc,
                helpers.element(name, 4, formulation),
                {"height": 0.1 * length, "width": 0.1 * length},
                {**helpers.STEEL, "E": 2.07e11 * force / length**2},
            )
        }
        loads = [
            *helpers.tip(2e5 * force, -5e5 * force),
            {"type": "moment", "at": "beam@1", "value": 1e5 * force * length},
            {"type": "distributed", "on": "beam", "value": [0, 1e4 * force / length]},
        ]
        out = helpers.solved(
            bodies, {"type": solver}, bc=[*CLAMP, {"type": "roller", "at": "beam@0.6", "normal": [1, 1]}], loads=loads
        )
        r = out.reactions()["w"]
        return np.array([*out.u("beam@1") / length, out.theta("beam@1"), r["fx"] / force, r["m"] / (force * length)])

    metres = tip(1.0, 1.0)
    for units in ((1000.0, 1.0), (1e-3, 1e-6)):
        np.testing.assert_allclose(tip(*units), metres, rtol=1e-9)


@pytest.mark.parametrize(("E", "slenderness"), [(1.0, 1e2), (1e15, 1e2), (2.07e11, 1e4), (2.07e11, 1.0)])
@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner3", "omar"])
def test_stiff_soft_stout_and_slender_beams_are_solved(name, E, slenderness):
    h = 1.0 / slenderness
    P = 0.5 * E * h**4 / 12
    bodies = {
        "beam": helpers.body(
            helpers.line(1.0), helpers.element(name, 8), {"height": h, "width": h}, {"E": E, "nu": 0.3, "rho": 1.0}
        )
    }
    out = helpers.solved(bodies, bc=CLAMP, loads=helpers.tip(0.0, -P))
    # with 1e4 omar's shear locks on eight elements
    if slenderness >= 100 and (name, slenderness) != ("omar", 1e4):
        assert out.u("beam@1")[1] == pytest.approx(-0.162143575658, rel=5e-2)
    assert out.state.t == 1.0


@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner3"])
def test_displacements_of_slender_beams_are_converged_not_only_their_forces(name):
    """With EA/EI = 1e9 a residual small relative to the axial forces can hide unconverged bending."""

    def tip(**more) -> np.ndarray:
        section = {"EA": 1e9, "kGA": 4e8, "EI": 1.0}
        out = helpers.cantilever(
            helpers.element(name, 8),
            helpers.tip(0, -5.0),
            section=section,
            length=1.0,
            solver={"type": "static", **more},
        )
        return out.u("beam@1")

    np.testing.assert_allclose(tip(steps=2), tip(steps=2, tolerance=1e-13), atol=1e-8)
    np.testing.assert_allclose(tip(steps=2), tip(steps=20), atol=1e-8)
