"""Load steps: their ends, their start, and their branch."""

import helpers
import numpy as np
import pytest
from scipy.optimize import brentq

STEEL = {"E": 2e11, "nu": 0.3, "rho": 7800}
CLAMP = [{"type": "clamp", "at": "rope@0"}]


def rope(name: str, count: int, length: float, side: float, angle: float = 0.0, material=STEEL):
    section = {"height": side, "width": side}
    return {"rope": helpers.body(helpers.line(length, angle), helpers.element(name, count), section, material)}


def warnings_of(out) -> list[str]:
    return [w for state in out.states for w in state.warnings]


def test_steps_to_a_negative_load_factor_mirror_those_to_the_positive_one():
    def tip(factor: float):
        solver = {"type": "static", "until": {"load_factor": factor}}
        return helpers.solved(rope("reissner3", 4, 2.0, 0.1), solver, bc=CLAMP, loads=[
            {"type": "force", "at": "rope@1", "value": [0.0, -500e3]}])

    down, up = tip(1.0), tip(-1.0)
    assert len(up.states) == len(down.states) == 10
    assert up.state.t == -1.0
    np.testing.assert_allclose(up.u("rope@1"), down.u("rope@1") * [1, -1], rtol=1e-9)


def test_load_factor_0_is_the_equilibrium_of_constant_loads():
    """A spring prestressed by 3 rad bends a cantilever's end to a circle: theta = -3 k/(k + EI/L)."""
    L, side, k = 1.0, 0.02, 1e6
    solver = {"type": "static", "until": {"load_factor": 0}}
    spring = {"type": "rotational", "between": ["rope@1", [0, 0]], "stiffness": k, "angle": 3.0}
    for name in ("reissner3", "cable"):
        out = helpers.solved(rope(name, 8, L, side), solver, bc=CLAMP, springs=[spring])
        assert [s.t for s in out.states] == [0.0]
        EI = STEEL["E"] * side**4 / 12
        assert out.theta("rope@1") == pytest.approx(-3.0 * k / (k + EI / L), rel=1e-3)
    none = helpers.solved(rope("reissner3", 8, L, side), solver, bc=CLAMP)
    assert [s.t for s in none.states] == [0.0]
    assert not none.d.any()


def test_an_elastic_body_returns_to_its_reference():
    """Increments fall faster than displacements, which end at 0: there is no size left to compare them with."""
    load = {"type": "force", "at": "rope@1", "value": [0, -470],
            "amplitude": {"type": "table", "t": [0, 0.5, 1], "value": [0, 1, 0]}}
    out = helpers.solved(rope("cable", 64, 1.0, 0.02), {"type": "static", "steps": 2}, bc=CLAMP, loads=[load])
    assert [s.t for s in out.states] == [0.5, 1.0]
    assert np.abs(out.d).max() < 1e-15


@pytest.mark.parametrize("name", ["reissner3", "vallejo", "cable"])
@pytest.mark.parametrize("angle", [1.5, -3.0])
def test_prestressed_springs_are_tightened_step_by_step(name, angle):
    """A beam on a pin turns until its spring is slack, however stiff that is; nothing else supports it."""
    spring = {"type": "rotational", "between": ["rope@0", [0, 0]], "stiffness": 1e6, "angle": angle}
    out = helpers.solved(rope(name, 4, 1.0, 0.02), bc=[{"type": "pin", "at": "rope@0"}], springs=[spring])
    assert out.theta("rope@1") == pytest.approx(-angle, rel=1e-9)


def test_a_spring_is_tightened_from_its_length_in_the_reference():
    """Its energy grows with the square of the load share, from zero to that of its natural length."""
    spring = {"type": "translational", "between": ["rope@1", [1.0, -2.0]], "stiffness": 3.0, "length": 0.5}
    model = helpers.build(rope("cable", 2, 1.0, 0.02), bc=CLAMP, springs=[spring])
    zero = np.zeros(len(model.numbering.place))
    for share in (0.0, 0.25, 1.0):
        model.springs[0].tighten(share)
        expected = pytest.approx(0.5 * 3.0 * (1.5 * share) ** 2, rel=1e-13, abs=1e-15)
        assert model.interactions.energies(zero, 1.0)[0] == expected


def test_a_slowly_growing_load_ends_at_the_state_of_the_full_load():
    """On a single branch, the state under a dead load does not depend on its history."""
    def tip(**amplitude):
        load = {"type": "force", "at": "rope@1", "value": [0.0, -500e3], **amplitude}
        return helpers.solved(rope("reissner3", 4, 2.0, 0.1), bc=CLAMP, loads=[load]).u("rope@1")

    table = {"type": "table", "t": [0, 0.5, 1], "value": [0, 0.01, 1]}
    np.testing.assert_allclose(tip(amplitude=table), tip(), rtol=1e-9)
    np.testing.assert_allclose(tip(amplitude={"type": "constant"}), tip(), rtol=1e-9)


def test_a_soft_straight_rope_sags_into_the_elastic_catenary():
    """Linear theory sees 1e7 of its length: x = H s/EA + H/w asinh(w s/H) from the middle, y alike (Irvine 1981)."""
    E, side, half, rho, g = 1e6, 1e-3, 5.0, 1000.0, 9.81
    EA, w = E * side**2, rho * side**2 * g

    def x(H):
        return H * half / EA + H / w * np.arcsinh(w * half / H) - half

    H = brentq(x, 1e-6, 1.0)
    sag = w * half**2 / (2 * EA) + H / w * (np.hypot(1.0, w * half / H) - 1.0)
    out = helpers.solved(
        rope("reissner3", 32, 2 * half, side, material={"E": E, "nu": 0.3, "rho": rho}),
        bc=[{"type": "pin", "at": "rope@0"}, {"type": "pin", "at": "rope@1"}],
        loads=[{"type": "gravity", "value": [0, -g]}],
    )
    assert -out.u("rope@0.5")[1] == pytest.approx(sag, rel=1e-3)


@pytest.mark.parametrize("name", ["reissner3", "cable"])
def test_a_rope_whose_end_moves_in_hangs_down(name):
    """Gravity is a small imperfection of a beam that buckles at 1e-4 of the path: the stable branch bends down."""
    out = helpers.solved(
        rope(name, 16, 10.0, 0.01),
        bc=[{"type": "pin", "at": "rope@0"}, {"type": "prescribed", "at": "rope@1", "x": 7.0, "y": 0.0}],
        loads=[{"type": "gravity", "value": [0, -9.81]}],
    )
    assert not warnings_of(out)
    assert all(s.history["negative_pivots"] == 0 for s in out.states)
    a = brentq(lambda a: 2 * a * np.sinh(3.5 / a) - 10.0, 1.0, 10.0)
    assert -out.u("rope@0.5")[1] == pytest.approx(a * (np.cosh(3.5 / a) - 1), rel=0.05)


def test_a_shortened_perfect_column_is_called_unstable_once_beyond_buckling():
    """Pinned at both ends it buckles at the strain pi^2 I/(A L^2), to 1e-4 as that changes the length itself."""
    side, L, shorter = 0.02, 2.0, 0.2
    out = helpers.solved(
        rope("cable", 16, L, side, np.pi / 2),
        bc=[{"type": "pin", "at": "rope@0"}, {"type": "prescribed", "at": "rope@1", "x": 0.0, "y": L - shorter}],
    )
    told = warnings_of(out)
    assert len(told) == 1
    assert told[0].startswith("unstable equilibrium from load factor")
    critical = np.pi**2 * side**2 / (12 * L**2) * L / shorter
    first = next(s for s in out.states if s.history["negative_pivots"] > 0)
    assert first.t == pytest.approx(critical, rel=5e-4)
    assert first.warnings == told


def test_steps_end_at_the_requested_factors():
    """States there are the equilibria of solutions that end there; factor 0 has only the constant loads."""
    spring = {"type": "translational", "between": ["rope@1", [1.0, -2.0]], "stiffness": 3.0, "length": 0.5}
    scene = {"bc": CLAMP, "springs": [spring], "loads": [{"type": "force", "at": "rope@1", "value": [0.0, -4e3]}]}
    factors = [0.0, 0.1234, 0.5, 0.777]
    solver = {"type": "static", "steps": 3, "max_iterations": 5}
    out = helpers.solved(rope("reissner3", 8, 1.0, 0.02), solver | {"factors": factors}, **scene)
    assert sum(s.history["cutbacks"] for s in out.states) > 0
    for factor in factors:
        (found,) = (s for s in out.states if abs(s.t - factor) < 1e-12)
        alone = helpers.solved(rope("reissner3", 8, 1.0, 0.02), solver | {"until": {"load_factor": factor}}, **scene)
        np.testing.assert_allclose(found.d, alone.d, atol=1e-9)
