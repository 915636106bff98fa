"""Derivatives of goals with contact: contact places move with a number of the case."""

import pytest
from test_study_gradient import differences_of_solves

import ancf2d
from ancf2d.solvers import lift_off
from ancf2d.study.gradient import gradient


@pytest.mark.slow
def test_a_strip_lifted_from_a_floor():
    """The place of lift-off moves with the force, which also changes the height."""
    case = ancf2d.load({
        "bodies": {"strip": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                             "section": {"EA": 1e6, "EI": 1.0, "rhoA": 1.0}, "element": {"type": "cable", "count": 8}}},
        "boundary_conditions": [{"type": "roller", "at": "strip@0", "fixed": "x"}],
        "loads": [{"type": "gravity", "value": [0, -9.81]},
                  {"name": "tip", "type": "force", "at": "strip@1", "value": [0, 3]}],
        "obstacles": {"floor": {"type": "half_plane", "through": [0, 0], "normal": [0, 1]}},
        "contacts": [{"between": ["strip", "floor"], "side": "axis"}],
        "solver": {"type": "static", "steps": 5}, "goal": {"probe": "tip", "quantity": "uy"},
        "output": {"probes": {"tip": "strip@1"}}})
    _, J = gradient(case, [case.case.goal], ["loads.tip.value.1"])
    expected = differences_of_solves(case, "loads.tip.value.1", 1e-2, lambda s: s.value)
    # runs may differ in which points on the floor bear it
    assert J[0] == pytest.approx([expected], rel=1e-4)


# a cantilever that its tip's load bends over a disc
BENT_OVER = {"bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                                 "section": {"height": 0.02, "width": 0.05},
                                 "material": {"E": 1e7, "nu": 0.3, "rho": 65.0}}},
             "boundary_conditions": [{"type": "clamp", "at": "beam@0"}],
             "obstacles": {"disc": {"type": "circle", "center": [0.87, -0.25], "radius": 0.22}},
             "contacts": [{"between": ["beam", "disc"], "side": "axis"}],
             "loads": [{"type": "force", "at": "beam@1", "value": [0, -1]}],
             "solver": {"type": "static", "steps": 4}, "goal": {"probe": "tip", "quantity": "uy"},
             "output": {"probes": {"tip": "beam@1"}}}


@pytest.mark.slow_rows("more0-11", "more2-11")
@pytest.mark.parametrize(("more", "count"), [
    ({}, 11), ({"contacts": [{"between": ["beam", "disc"], "side": "axis", "law": {"stiffness": 1e5}}]}, 5),
    ({"solver": {"type": "eigen", "about": "static", "modes": 1}, "goal": {"kind": "bending", "number": 1}}, 11)])
def test_a_beam_over_a_disc(monkeypatch, more, count):
    """Derivatives agree with differences of runs whose contact places converge; with the law, near an edge of it."""
    monkeypatch.setattr(lift_off, "STEP_TOLERANCE", 1e-9)
    beam = {**BENT_OVER["bodies"]["beam"], "element": {"type": "reissner2", "count": count}}
    case = {**BENT_OVER, "bodies": {"beam": beam}, **more}
    values = {"bodies.beam.geometry.end.0": 1.0, "obstacles.disc.radius": 0.22}
    for row in ancf2d.sensitivity(case, list(values)).rows:
        path, value = row.path, values[row.path]
        a, b, c, d = (ancf2d.solve(case, [f"{path}={value * (1 + k * 1e-5)!r}"], states=False).value
                      for k in (-2, -1, 1, 2))
        assert row.method == "exact"
        assert row.derivative == pytest.approx((a - 8 * b + 8 * c - d) / (12e-5 * value), rel=1e-6)
        assert row.error < 1e-6 * abs(row.derivative)


def test_the_first_friction_is_differentiated_by_runs():
    """Equilibria with friction depend on the path, so the response without friction is not their derivative."""
    case = {**BENT_OVER, "bodies": {"beam": {**BENT_OVER["bodies"]["beam"], "element": {"type": "cable", "count": 4}}}}
    row, other = ancf2d.sensitivity(case, ["contacts.0.friction", "obstacles.disc.radius"]).rows
    if row.path != "contacts.0.friction":
        row, other = other, row
    smooth, rough = (ancf2d.solve(case, [f"contacts.0.friction={mu}"], states=False).value for mu in (0.0, 1e-3))
    assert row.derivative == pytest.approx((rough - smooth) / 1e-3, rel=1e-2)
    assert "friction depends on the load path" in row.method
    assert other.method == "exact"


# bodies that touch between their nodes: an arch on a side of a polyline, and over another body
ARCH = {"geometry": {"type": "arc", "center": [0, 1], "radius": 1.0, "from": 3.9, "to": 5.0},
        "section": {"height": 0.02, "width": 0.05}, "material": {"E": 1e7, "nu": 0.3},
        "element": {"type": "cable", "count": 5}}
LEDGE = {"geometry": {"type": "line", "start": [-0.2, -0.03], "end": [0.8, -0.02]}, "section": ARCH["section"],
         "material": ARCH["material"], "element": {"type": "cable", "count": 3}}
TOUCHED = {"polyline": ({"floor": {"type": "polyline", "points": [[-1, -0.02], [0.3, -0.01], [2, 0.01]]}}, {}, []),
           "body": ({}, {"floor": LEDGE}, [{"type": "clamp", "at": "floor@0"}, {"type": "clamp", "at": "floor@1"}])}


@pytest.mark.slow
@pytest.mark.parametrize(("what", "method"), [
    ("polyline", "exact"),
    ("body", "differences of runs: contact points between nodes differ between runs")])
def test_contact_places_are_unknowns_at_obstacles_and_found_by_runs_between_bodies(what, method):
    """The contact place moves with a number, and the force with it."""
    obstacles, bodies, held = TOUCHED[what]
    case = ancf2d.load({
        "bodies": {"arch": ARCH, **bodies}, "obstacles": obstacles, "contacts": [{"between": ["arch", "floor"]}],
        "boundary_conditions": [{"type": "clamp", "at": "arch@0"}, *held],
        "loads": [{"name": "tip", "type": "force", "at": "arch@0.9", "value": [0.05, -0.6]}],
        "solver": {"type": "static", "steps": 3}, "goal": {"probe": "tip", "quantity": "uy"},
        "output": {"probes": {"tip": "arch@1"}}})
    row, = ancf2d.sensitivity(case, ["loads.tip.value.1"]).rows
    assert row.method == method
    expected = differences_of_solves(case, row.path, 3e-3, lambda s: s.value)
    assert row.derivative == pytest.approx(expected, rel=1e-3)
