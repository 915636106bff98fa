"""N, Q and M at any point compared with statics by hand, and the forces of a steadily turning frame."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers import covering

from ancf2d.case import load_case_text
from ancf2d.model.build import build_model
from ancf2d.solvers.registry import solve
from ancf2d.solvers.section_forces import SectionForces
from ancf2d.study.run import run_case

TYPES = ["2d2n", "2d3n-nu", "vallejo", "patel", "omar, formulation: structural", "cable", "reissner2",
         "reissner3", "ancf, order: [3, 3]"]
BEAM = """
bodies:
  beam:
    geometry: {{type: line, start: [0, 0], end: [2, 0]}}
    section: {{height: 0.1, width: 0.2}}
    material: {{E: 2e11, nu: 0.3, rho: 1000}}
    element: {{type: {element}, count: 3, nodes: {nodes}}}
{rest}
output: {{probes: {{p: beam@{s}}}, fields: [N]}}
"""


def forces(element: str, rest: str, s: float, nodes: str = "regular") -> tuple[float, float, float]:
    """Return N, Q, M at S = s."""
    probe = run_case(load_case_text(BEAM.format(element=element, rest=rest, s=s, nodes=nodes))).summary["probes"]["p"]
    return probe["N"], probe["Q"], probe["M"]


@covering(element=TYPES, s=[0.0, 0.21, 0.5, 1.0])
def test_uniform_load_on_a_simply_supported_beam(element: str, s: float) -> None:
    """M = q x (L - x)/2 and Q = q (x - L/2) for weight and a line load together, N of an end force."""
    rest = """
boundary_conditions: [{type: pin, at: beam@0}, {type: roller, at: beam@1, fixed: y}]
loads:
  - {type: gravity, value: [0, -10]}
  - {type: distributed, on: beam, value: [0, -300]}
  - {type: force, at: beam@1, value: [50, 0]}
solver: {type: linear_static}"""
    N, Q, M = forces(element, rest, s)
    q, x, L = 1000 * 0.02 * 10 + 300, 2 * s, 2.0
    assert pytest.approx(50, rel=1e-6) == N
    assert pytest.approx(q * (x - L / 2), rel=1e-6, abs=1e-6 * q) == Q
    assert pytest.approx(q * x * (L - x) / 2, rel=1e-6, abs=1e-6 * q) == M


@pytest.mark.parametrize("element", TYPES)
def test_partial_load_on_a_cantilever(element: str) -> None:
    """Within a partial load only the part beyond the section counts."""
    rest = """
boundary_conditions: [{type: clamp, at: beam@0}]
loads: [{type: distributed, on: beam, value: [0, -300], from: 0.3, to: 0.8}]
solver: {type: linear_static}"""
    _, Q, M = forces(element, rest, 0.45)
    beyond = 2 * (0.8 - 0.45)
    assert pytest.approx(-300 * beyond, rel=1e-6) == Q
    assert pytest.approx(-300 * beyond**2 / 2, rel=1e-6) == M


@pytest.mark.parametrize("element", TYPES)
def test_centrifugal_tension_of_a_turning_beam(element: str) -> None:
    """N = rho A Omega^2 ((L + a)^2 - (x + a)^2)/2 with the hub a = 0.5 outside the centre."""
    rest = """
boundary_conditions: [{name: hub, type: clamp, at: beam@0, hold: section}]
steady_rotation: {omega: 3, about: [-0.5, 0]}
solver: {type: static, steps: 2}"""
    N, Q, M = forces(element, rest, 0.4)
    expected = 20 * 9 * (2.5**2 - 1.3**2) / 2
    assert math.isclose(N, expected, rel_tol=1e-6)
    assert abs(Q) + abs(M) < 1e-6 * expected


def test_centrifugal_tension_follows_the_load_factor() -> None:
    """Half of omega^2 is half of the force, as the beam hardly stretches."""
    rest = """
boundary_conditions: [{type: clamp, at: beam@0}]
steady_rotation: {omega: 3, about: [-0.5, 0]}
solver: {type: static, steps: 2}"""
    model = build_model(load_case_text(BEAM.format(element="reissner3", rest=rest, s=0, nodes="regular")))
    at_start = SectionForces(model, model.meshes["beam"], np.zeros(1))
    half, whole = (float(at_start(state)[0, 0, 0]) for state in solve(model))
    assert whole > 0
    assert half == pytest.approx(0.5 * whole, rel=1e-5)


@pytest.mark.parametrize("element", ["2d2n", "vallejo", "cable", "reissner3"])
def test_a_follower_line_load_acts_along_the_axes_of_a_tilted_beam(element: str) -> None:
    """In the beam's axes, the part beyond the section pulls with p, and bends with q."""
    rest = """
boundary_conditions: [{type: clamp, at: beam@0, hold: section}]
loads: [{type: distributed, on: beam, value: [200, -300], follower: true}]
solver: {type: linear_static}"""
    tilted = BEAM.replace("end: [2, 0]", "end: [1.2, 1.6]").format(element=element, rest=rest, s=0.45, nodes="regular")
    probe = run_case(load_case_text(tilted)).summary["probes"]["p"]
    beyond = 2 * (1 - 0.45)
    assert probe["N"] == pytest.approx(200 * beyond, rel=1e-6)
    assert probe["Q"] == pytest.approx(-300 * beyond, rel=1e-6)
    assert probe["M"] == pytest.approx(-300 * beyond**2 / 2, rel=1e-6)


def test_a_point_mass_pulls_with_its_own_centrifugal_force() -> None:
    rest = """
boundary_conditions: [{name: hub, type: clamp, at: beam@0}]
masses: [{at: beam@1, mass: 7}]
steady_rotation: {omega: 3, about: [-0.5, 0.2]}
solver: {type: static, steps: 2}"""
    text = BEAM.format(element="reissner3", rest=rest, s=0.5, nodes="regular")
    hub = run_case(load_case_text(text)).summary["reactions"]["hub"]
    # the beam stretches by 1e-7 of its length only
    assert math.isclose(-hub["fx"], 9 * (40 * 1.5 + 7 * 2.5), rel_tol=1e-5)
    assert math.isclose(-hub["fy"], 9 * 47 * -0.2, rel_tol=1e-4)


@pytest.mark.parametrize("element", TYPES)
def test_centrifugal_stiffness_is_the_derivative_of_the_force(element: str) -> None:
    rest = """
boundary_conditions: [{type: clamp, at: beam@0}]
steady_rotation: {omega: 3, about: [-0.5, 0.3]}
solver: {type: static}"""
    model = build_model(load_case_text(BEAM.format(element=element, rest=rest, s=0, nodes="regular")))
    (patch,) = model.loads.patches
    rng = np.random.default_rng(3)
    d, v = rng.normal(size=(2, model.n_q))
    _, Q0, K = patch.evaluate(model.e0 + d, d, 0.7)
    _, Q1, _ = patch.evaluate(model.e0 + d + v, d + v, 0.7)
    np.testing.assert_allclose(Q1 - Q0, np.einsum("mij,mj->mi", K, v[patch.dofs]), rtol=1e-10, atol=1e-10)


@covering(element=TYPES, s=[0.4, 0.5, 0.6, 0.9])
def test_force_and_moment_between_nodes(element: str, s: float) -> None:
    """On both sides of a force P at a, and of a moment C at b, within one element, M is that of statics."""
    rest = """
boundary_conditions: [{type: clamp, at: beam@0, hold: section}]
loads: [{type: force, at: beam@0.45, value: [20, -100]}, {type: moment, at: beam@0.55, value: 30}]
solver: {type: linear_static}"""
    N, Q, M = forces(element, rest, s)
    x, beyond = 2 * s, s < 0.45
    assert pytest.approx(20 if beyond else 0, abs=1e-4) == N
    assert pytest.approx(-100 if beyond else 0, abs=1e-4) == Q
    assert pytest.approx((-100 * (0.9 - x) if beyond else 0) + (30 if s < 0.55 else 0), abs=1e-3) == M


@pytest.mark.parametrize("element", ["vallejo", "cable", "reissner3"])
def test_a_follower_force_between_nodes_turns_with_its_section(element: str) -> None:
    """Beyond it there is no force; before it the force is rotated by the angle of the beam in between."""
    rest = """
boundary_conditions: [{type: clamp, at: beam@0, hold: section}]
loads: [{type: follower_force, at: beam@0.45, value: [0, -4e5]}]
solver: {type: static, steps: 4}"""
    assert max(abs(v) for v in forces(element, rest, 0.5)) < 1.0
    N, Q, M = forces(element, rest, 0.44)
    assert math.hypot(N, Q) == pytest.approx(4e5, rel=1e-5)
    assert pytest.approx(-4e5, rel=1e-2) == Q
    assert pytest.approx(-4e5 * 0.02, rel=5e-2) == M


WALL = "boundary_conditions: [{type: clamp, at: beam@0, hold: section}"
POST = """
  post:
    geometry: {type: line, start: [0.9, 0], end: [0.9, 1]}
    section: {height: 0.1, width: 0.2}
    material: {E: 2e11, nu: 0.3, rho: 1000}
    element: {type: reissner3, count: 1}
"""
# what acts at S = 0.45, and N, Q, M right before it: beyond nothing is left
ATTACHED = {
    "mass": (f"{WALL}]\nmasses: [{{at: beam@0.45, mass: 50}}]\nloads: [{{type: gravity, value: [0, -10], "
             "amplitude: {type: constant}}]", (0.0, -500.0, 0.0)),
    "turning mass": (f"{WALL}]\nmasses: [{{at: beam@0.45, mass: 50}}]\nsteady_rotation: {{omega: 2, about: [0, 0]}}",
                     (50 * 0.9 * 4.0, 0.0, 0.0)),
    "spring": (f"{WALL}]\nsprings: [{{type: translational, between: [beam@0.45, [0.9, -1]], stiffness: 10, "
               "length: 0.5}]", (0.0, -5.0, 0.0)),
    "torsion spring": (f"{WALL}]\nsprings: [{{type: rotational, between: [[0, 0], beam@0.45], stiffness: 10, "
                       "angle: 0.5}]", (0.0, 0.0, 5.0)),
    "weld": (POST + f"{WALL}]\njoints: [{{type: weld, between: [beam@0.45, post@0]}}]\n"
             "loads: [{type: force, at: post@1, value: [20, -100]}]", (20.0, -100.0, -20.0)),
    "prismatic": (POST + f"{WALL}, {{type: roller, at: post@0, fixed: x}}, {{type: roller, at: post@1, fixed: x}}]\n"
                  "joints: [{type: prismatic, point: post@0, on: beam}]\n"
                  "loads: [{type: force, at: post@1, value: [0, -100]}]", (0.0, -100.0, 0.0)),
    "torque": (f"{WALL}]\nloads: [{{type: torque, between: [beam@0.45, [0, 0]], value: 30}}]", (0.0, 0.0, -30.0)),
    # the eyelet is 0.3 above the axis, and both stretches leave it at right angles
    "eyelet": (f"{WALL}]\nloads: [{{type: tendon, through: [[0.9, 2], {{at: beam@0.45, y: 0.3}}, [3, 0.3]], "
               "tension: 20}]", (20.0, 20.0, -6.0)),
    "elastic eyelet": (f"{WALL}]\nloads: [{{type: tendon, through: [[0.9, 2.3], {{at: beam@0.45, y: 0.3}}, "
                       "[3.9, 0.3]], stiffness: 10, slack: -3}]", (15.0, 15.0, -4.5)),
    "support": (f"{WALL}, {{type: prescribed, at: beam@0.45, uy: -1e-6}}]",
                (0.0, -1e-6 * 3 * 2e11 * 0.2e-3 / 12 / 0.9**3, 0.0)),
}


@covering(element=["vallejo, formulation: structural", "cable", "reissner3"], kind=ATTACHED,
          nodes=["regular", "acting"])
def test_items_between_nodes_act_at_their_positions(element: str, kind: str, nodes: str) -> None:
    rest, (N, Q, M) = ATTACHED[kind]
    # the beam has no weight worth the name
    beam = BEAM.replace("rho: 1000", "rho: 1e-9").replace("{rest}", "{rest}\nsolver: {{type: static}}")
    size, arm = max(abs(N), abs(Q), abs(M)), 0.9 - 0.84
    for s, expected in ((0.42, (N, Q, M + Q * arm)), (0.48, (0.0, 0.0, 0.0))):
        text = beam.format(element=element, rest=rest, s=s, nodes=nodes)
        found = run_case(load_case_text(text)).summary["probes"]["p"]
        # supports beside a shear of their own, whose stiffness is not the bending one's alone
        rel = 5e-2 if kind == "support" else 1e-4
        assert [found[k] for k in "NQM"] == pytest.approx(expected, rel=rel, abs=1e-4 * size)


# what acts on whole sections or beside the axis at the ends, and N, Q, M between them, with x = 2 s
END = "boundary_conditions: [{type: clamp, at: beam@0}]\nloads: "
ACROSS = {
    "breathing clamp": ("""
boundary_conditions: [{type: clamp, at: beam@0, hold: breathe}]
loads: [{type: force, at: beam@1, value: [20, -100]}]""", lambda x: (20.0, -100.0, -100.0 * (2 - x))),
    "spread pins": ("""
boundary_conditions:
  - {type: pin, at: beam@0, spread: uniform}
  - {type: roller, at: beam@1, fixed: y, spread: parabolic}
loads: [{type: force, at: beam@1, value: [20, 0], spread: uniform}, {type: moment, at: beam@0, value: 30}]
""", lambda x: (20.0, -15.0, -15.0 * (2 - x))),
    "spread force": (END + "[{type: force, at: beam@1, value: [20, -100], spread: parabolic}]",
                     lambda x: (20.0, -100.0, -100.0 * (2 - x))),
    "spread follower": (END + "[{type: follower_force, at: beam@1, value: [20, -100], spread: uniform}]",
                        lambda x: (20.0, -100.0, -100.0 * (2 - x))),
    "eyelets": (END + "[{type: tendon, through: [{at: beam@0, y: 0.04}, {at: beam@1, y: 0.04}], tension: 50}]",
                lambda x: (-50.0, 0.0, 2.0))}


@covering(element=["2d2n", "2d3n", "2d2n-nu", "2d3n-nu", "vallejo"], kind=ACROSS, s=[0, 0.1, 0.3333333333333333, 1])
def test_forces_on_whole_sections_act_at_the_ends_of_their_elements(element: str, kind: str, s: float) -> None:
    """In types with a common coefficient of x^2 and y^2 they act on coordinates of other nodes, too."""
    rest, exact = ACROSS[kind]
    found = forces(element, f"{rest}\nsolver: {{type: linear_static}}", s)
    assert found == pytest.approx(exact(2 * s), rel=1e-6, abs=1e-4)


@pytest.mark.parametrize("law", ["", pytest.param("law: {stiffness: 1e9}", marks=pytest.mark.slow)])
@pytest.mark.parametrize("element", ["2d2n", pytest.param("2d3n", marks=pytest.mark.slow)])
def test_contact_at_the_corner_of_a_section_acts_at_the_end_of_its_element(element: str, law: str) -> None:
    """A floor bears the end of a cantilever, which sags: between the corner there and the load, Q is its force."""
    rest = """
boundary_conditions: [{type: clamp, at: beam@0}]
loads: [{type: force, at: beam@0.5, value: [0, -2000]}]
obstacles: {floor: {type: half_plane, through: [0, -0.0502], normal: [0, 1]}}
contacts: [{between: [beam, floor], LAW}]
solver: {type: static}""".replace("LAW", law)
    text = BEAM.format(element=element, rest=rest, s=0.9, nodes="acting")
    summary = run_case(load_case_text(text)).summary
    force, at = summary["reactions"]["floor"]["fy"], summary["probes"]["p"]
    assert force > 100.0
    assert at["Q"] == pytest.approx(force, rel=1e-4)
    # a layer bears along a part of the face
    assert law or at["M"] == pytest.approx(0.2 * force, rel=1e-2)
