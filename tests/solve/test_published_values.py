"""Published values and closed forms of beams: thick and slender cantilevers, elastica, roll-up, convergence."""

import helpers
import numpy as np
import pytest

THICK = {"height": 0.5, "width": 0.1}
# Nachbagauer, Pechstein, Irschik & Gerstmayr 2011; two-node figures as quoted in Exudyn's ANCFBeamTest.py.
# The "linear" figures are a nonlinear solve at the small load: their u is of second order.
TWO_NODE = [
    (1, 9.12273046e-8, 6.16666566e-4, 0.07140274, 0.54225823),
    (2, 1.61293091e-7, 7.61594059e-4, 0.12379212, 0.65687111),
    (4, 1.81763233e-7, 7.97825954e-4, 0.14346767, 0.69593561),
    (8, 1.87065375e-7, 8.06883929e-4, 0.14904162, 0.70681526),
]
THREE_NODE = [
    (1, 1.8698212e-7, 8.0990321e-4, 0.13971417, 0.68775242),
    (4, 1.8884187e-7, 8.0990325e-4, 0.15090938, 0.71040910),
]
EXACT_SMALL, EXACT_LARGE = (1.88849163418e-7, 8.09903253977e-4), (0.150971144239, 0.710568597854)


def thick(name: str, formulation: str | None, count: int, P: float, solver="static", **more) -> np.ndarray:
    out = helpers.cantilever(
        helpers.element(name, count, formulation, **more), helpers.tip(0, -P), section=THICK, solver=solver
    )
    return -out.u("beam@1")


@pytest.mark.parametrize(
    ("name", "row"),
    [("kerkkanen", r) for r in TWO_NODE] + [("vallejo", r) for r in THREE_NODE],
    ids=lambda v: v if isinstance(v, str) else str(v[0]),
)
def test_thick_cantilever_in_structural_form_is_nachbagauers(name, row):
    count, u_small, v_small, u, v = row
    np.testing.assert_allclose(thick(name, "structural", count, 62.5e6), [u, v], atol=6e-9)
    # printed to eight and nine digits
    np.testing.assert_allclose(thick(name, "structural", count, 62.5e3), [u_small, v_small], rtol=2e-8)


@pytest.mark.parametrize(("name", "formulation", "count"), [("reissner3", None, 64), ("vallejo", "structural", 64)])
def test_thick_cantilever_converges_to_the_geometrically_exact_beam(name, formulation, count):
    np.testing.assert_allclose(thick(name, formulation, count, 62.5e6), EXACT_LARGE, rtol=1e-7)
    np.testing.assert_allclose(thick(name, formulation, count, 62.5e3), EXACT_SMALL, rtol=1e-7)


@pytest.mark.parametrize(
    ("formulation", "expected"), [("strain_split", (0.15843463, 0.71578774)), ("enhanced", (0.15817508, 0.71523804))]
)
def test_thick_cantilever_in_continuum_forms_without_poisson_locking(formulation, expected):
    """vallejo, 8 elements, 2 x 2 points: the limit differs from the beam's by the bending-stretch coupling."""
    np.testing.assert_allclose(thick("vallejo", formulation, 8, 62.5e6, quadrature=[2, 2]), expected, atol=6e-9)


def test_limits_of_the_continuum_forms():
    np.testing.assert_allclose(thick("vallejo", "enhanced", 64, 62.5e6), [0.15818, 0.71524], atol=6e-6)
    assert thick("vallejo", "enhanced", 64, 62.5e3, "linear_static")[1] == pytest.approx(8.09903e-4, abs=6e-10)
    np.testing.assert_allclose(thick("vallejo", "continuum", 64, 62.5e6), [0.13651, 0.66707], atol=1e-5)
    assert thick("vallejo", "continuum", 64, 62.5e3, "linear_static")[1] == pytest.approx(7.40338e-4, abs=6e-10)


def timoshenko_tip(P: float, h: float, L: float = 2.0, b: float = 0.1, E: float = 2.07e11, nu: float = 0.3) -> float:
    k, G = 10 * (1 + nu) / (12 + 11 * nu), E / (2 * (1 + nu))
    return P * L**3 / (3 * E * b * h**3 / 12) + P * L / (k * G * b * h)


@pytest.mark.parametrize("count", [2, 3, 8])
@pytest.mark.parametrize("h", [0.5, 0.1, 0.001])
def test_enhanced_vallejo_with_two_points_is_exact_at_its_nodes_in_the_linear_case(h, count):
    spec = helpers.element("vallejo", count, "enhanced", quadrature=[2, 2])
    out = helpers.cantilever(spec, helpers.tip(0, -1.0), section={"height": h, "width": 0.1}, solver="linear_static")
    assert -out.u("beam@1")[1] == pytest.approx(timoshenko_tip(1.0, h), rel=1e-10 if h > 0.01 else 1e-7)


def test_simply_supported_enhanced_vallejo_is_timoshenkos_beam_from_two_elements():
    beam = {
        "b": helpers.body(
            helpers.line(2.0),
            helpers.element("vallejo", 2, "enhanced", quadrature=[2, 2]),
            {"height": 0.1, "width": 0.1},
            helpers.STEEL,
        )
    }
    out = helpers.solved(
        beam,
        "linear_static",
        bc=[{"type": "pin", "at": "b@0"}, {"type": "roller", "at": "b@1", "fixed": "y"}],
        loads=[{"type": "force", "at": "b@0.5", "value": [0, -1000]}],
    )
    # two halves, each a cantilever under half the force
    assert -out.u("b@0.5")[1] == pytest.approx(timoshenko_tip(500.0, 0.1, 1.0), rel=1e-12)


def slim(name: str, count: int, section: dict, loads, formulation: str | None = None):
    return helpers.cantilever(helpers.element(name, count, formulation), loads, section=section, length=1.0)


ELASTICA = [
    (0.5, 0.162143575658, 0.0159189624708, 0.244533647133),
    (1, 0.301720773800, 0.0564332362834, 0.461351949712),
    (2, 0.493457480397, 0.160641720825, 0.781749831557),
    (5, 0.713791523612, 0.387628360724, 1.21536811761),
    (10, 0.810609024880, 0.554995597754, 1.43028553880),
]


@pytest.mark.parametrize(("P", "v", "u", "theta"), ELASTICA)
def test_elastica(P, v, u, theta):
    """Without shear and stretch (Mattiasson 1981), by stiffnesses 1e9 times the bending stiffness."""
    out = slim("reissner3", 32, {"EA": 1e9, "kGA": 1e9, "EI": 1.0}, helpers.tip(0, P))
    np.testing.assert_allclose(out.u("beam@1"), [-u, v], atol=2e-7)
    assert out.theta("beam@1") == pytest.approx(theta, abs=2e-7)


@pytest.mark.parametrize(
    ("kGA", "u", "v"), [(500, 0.0569234887482, 0.303327170361), (50, 0.0613156583730, 0.317813873942)]
)
def test_elastica_with_shear(kGA, u, v):
    """Batista 2016."""
    out = slim("reissner3", 32, {"EA": 1e9, "kGA": kGA, "EI": 1.0}, helpers.tip(0, 1.0))
    np.testing.assert_allclose(out.u("beam@1"), [-u, v], atol=1e-8)


@pytest.mark.parametrize("t", [1.0, np.pi, 2 * np.pi])
@pytest.mark.parametrize(
    ("name", "formulation", "count", "accuracy"),
    [("reissner3", None, 16, 5e-7), ("vallejo", "structural", 64, 2e-6), ("cable", None, 64, 2e-6)],
)
def test_roll_up_by_an_end_moment(name, formulation, count, accuracy, t):
    section = {"EA": 1e4, "kGA": 5e3, "EI": 1.0}
    out = slim(name, count, section, [{"type": "moment", "at": "beam@1", "value": t}], formulation)
    np.testing.assert_allclose(out.u("beam@1"), [np.sin(t) / t - 1, (1 - np.cos(t)) / t], atol=accuracy)


@pytest.mark.parametrize(
    ("name", "formulation", "expected"),
    [
        ("cable", None, (0.508537304326, 1.207239854550)),
        ("reissner3", None, (0.509464717745, 1.20882282956)),
        ("vallejo", "structural", (0.509464717745, 1.20882282956)),
    ],
)
def test_slender_cantilever(name, formulation, expected):
    """Gerstmayr & Irschik 2008: P = 3 EI/L^2."""
    P = 3 * 2.07e11 * 0.1**4 / 12 / 4
    out = helpers.cantilever(helpers.element(name, 64, formulation), helpers.tip(0, -P))
    np.testing.assert_allclose(-out.u("beam@1"), expected, rtol=1e-6)


@pytest.mark.parametrize(("count", "published", "accuracy"), [(1, (0.362244729891, 0.994144758725), 8e-4),
                                                                  (4, (0.507428715119, 1.205533702233), 3e-6)])
def test_cables_with_five_gauss_points_agree_with_another_program(count, published, accuracy):
    """Gerstmayr & Irschik 2008, with three points for the curvature; by default one element is within 4 %."""
    load = helpers.tip(0, -3 * 2.07e11 * 0.1**4 / 12 / 4)
    five = helpers.cantilever({"type": "cable", "count": count, "quadrature": [5, 1]}, load)
    np.testing.assert_allclose(-five.u("beam@1"), published, rtol=accuracy)
    own = helpers.cantilever(helpers.element("cable", count), load)
    np.testing.assert_allclose(-own.u("beam@1"), (0.508537304326, 1.207239854550), rtol=0.04)


def frame(name: str, formulation: str | None, P: float) -> np.ndarray:
    """Lee's frame: legs of 120, load 24 from the corner, hinged at both ends."""
    legs = {
        "f": helpers.body(
            {"type": "polyline", "points": [[0, 0], [0, 120], [120, 120]]},
            helpers.element(name, 40, formulation, **({} if name == "cable" else {"shear_factor": 5 / 6})),
            {"A": 6, "I": 2, "height": 2},
            {"E": 7.2e6, "nu": 0.3},
        )
    }
    out = helpers.solved(
        legs,
        bc=[{"name": "a", "type": "pin", "at": "f@0"}, {"name": "b", "type": "pin", "at": "f@1"}],
        loads=[{"type": "force", "at": "f@0.6", "value": [0, -P]}],
    )
    r = out.reactions()
    assert r["a"]["fy"] + r["b"]["fy"] == pytest.approx(P, rel=1e-8)
    assert r["a"]["fx"] == pytest.approx(-r["b"]["fx"], rel=1e-8)
    return out.u("f@0.6")


def test_lees_frame_agrees_for_every_beam():
    P = 9000.0
    reference = frame("reissner3", None, P)
    assert reference[1] < -5
    np.testing.assert_allclose(frame("vallejo", "structural", P), reference, rtol=1e-5)
    np.testing.assert_allclose(frame("cable", None, P), reference, rtol=5e-3)


def orders(values, exact) -> np.ndarray:
    errors = np.abs(np.array(values) - exact)
    return np.log2(errors[:-1] / errors[1:])


@pytest.mark.parametrize(
    ("name", "formulation", "counts", "expected"),
    [
        ("kerkkanen", "structural", (8, 16, 32), 2.0),
        ("reissner2", None, (8, 16, 32), 2.0),
        ("vallejo", "structural", (2, 4, 8), 4.0),
        ("reissner3", None, (2, 4, 8), 4.0),
    ],
)
def test_orders_of_convergence(name, formulation, counts, expected):
    values = [thick(name, formulation, n, 62.5e6)[1] for n in counts]
    assert orders(values, EXACT_LARGE[1])[-1] == pytest.approx(expected, abs=0.2)


@helpers.every_small_variant
def test_refinement_converges(name, formulation):
    """On ever finer meshes the default rule must converge: a weak hidden mode would let the answer drift."""
    v = [thick(name, formulation, n, 62.5e3, "linear_static")[1] for n in (8, 32, 128)]
    # a quarter of the mesh leaves at most a bit more than a quarter of the change
    assert abs(v[2] - v[1]) < 0.32 * abs(v[1] - v[0]) or abs(v[2] - v[1]) < 1e-6 * v[0]
    assert v[2] == pytest.approx(EXACT_SMALL[1], rel=0.09)


@pytest.mark.parametrize("name", ["vallejo", "cable", "reissner3", "kerkkanen", "ancf[3,3]"])
def test_the_limit_of_a_type_does_not_depend_on_a_fine_rule(name):
    """More points than the default do not change the limit."""
    nx, ny = (helpers.TYPES[name].degree_x + 2, helpers.TYPES[name].degree_y + 3)
    v = [thick(name, None, 64, 62.5e3, "linear_static", **q)[1] for q in ({}, {"quadrature": [nx, ny]})]
    assert v[0] == pytest.approx(v[1], rel=2e-3)
