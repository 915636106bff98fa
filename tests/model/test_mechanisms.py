"""Rigid motions that nothing prevents are found before solving and named; supported models are not refused."""

import math

import helpers
import pytest

import ancf2d
from ancf2d.errors import CaseError

NAMES = list(helpers.KINDS.values())


def scene(name: str, bc, joints=(), springs=(), second: bool = False, solver: str = "static"):
    bodies = {"a": helpers.body(helpers.line(1.0), helpers.element(name, 2))}
    if second:
        bodies["b"] = helpers.body(helpers.line(1.0, 0.0, (1.0, 0.0)), helpers.element(name, 2))
    return helpers.build(bodies, solver, bc=bc, joints=joints, springs=springs)


PIN0, PIN1 = {"type": "pin", "at": "a@0"}, {"type": "pin", "at": "b@1"}
HINGE = {"type": "pin", "between": ["a@1", "b@0"]}
WELD = {"type": "weld", "between": ["a@1", "b@0"]}
CLAMP = {"type": "clamp", "at": "a@0"}


def roller(at: str, fixed: str) -> dict:
    return {"type": "roller", "at": at, "fixed": fixed}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("bc", "joints", "second", "motions"),
    [
        ([], [], False, 3),
        ([PIN0], [], False, 1),
        ([roller("a@0", "y"), roller("a@1", "y")], [], False, 1),
        ([roller("a@0", "x"), roller("a@1", "x")], [], False, 2),
        ([roller("a@0.3", "y")], [], False, 2),
        ([CLAMP], [HINGE], True, 1),
        ([PIN0], [HINGE], True, 2),
        ([CLAMP], [], True, 3),
        ([PIN0, PIN1], [HINGE], True, 1),
    ],
)
def test_mechanisms_are_refused_with_one_sentence_per_motion(name, bc, joints, second, motions):
    with pytest.raises(CaseError, match="no static solution") as error:
        scene(name, bc, joints, second=second)
    assert len(error.value.problems) == motions


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("bc", "joints", "second"),
    [
        ([CLAMP], [], False),
        ([{"type": "clamp", "at": "a@0.37"}], [], False),
        ([PIN0, roller("a@1", "y")], [], False),
        ([PIN0, {"type": "prescribed", "at": "a@0", "angle": 0.1}], [], False),
        ([PIN0, {"type": "roller", "at": "a@1", "normal": [1, 1]}], [], False),
        ([roller("a@0", "y"), roller("a@1", "y"), roller("a@0", "x")], [], False),
        ([CLAMP], [WELD], True),
        ([CLAMP, roller("b@1", "y")], [HINGE], True),
        ([CLAMP, PIN1], [HINGE], True),
    ],
)
def test_supported_models_are_not_refused(name, bc, joints, second):
    scene(name, bc, joints, second=second)


@pytest.mark.parametrize("name", NAMES)
def test_springs_prevent_mechanisms(name):
    spring = {"type": "rotational", "between": ["a@1", "b@0"], "stiffness": 2.0}
    scene(name, [CLAMP], [HINGE], [spring], second=True)
    lift = {"type": "translational", "between": ["a@1", [1.0, 1.0]], "stiffness": 2.0}
    scene(name, [PIN0], [], [lift])
    along = {"type": "translational", "between": ["a@1", [2.0, 0.0]], "stiffness": 2.0}
    with pytest.raises(CaseError, match="no static solution"):
        scene(name, [PIN0], [], [along])


def test_a_rotation_is_named_with_its_pole_and_a_translation_with_its_direction():
    with pytest.raises(CaseError, match=r"'a' is free to turn about \(0, 0\)"):
        scene("vallejo", [PIN0])
    with pytest.raises(CaseError, match=r"'a' is free to move along \(1, 0\)"):
        scene("vallejo", [roller("a@0", "y"), roller("a@1", "y")])
    with pytest.raises(CaseError, match=r"'b' is free to turn about \(1, 0\)"):
        scene("vallejo", [CLAMP], [HINGE], second=True)


def test_a_blade_on_a_hinge_is_referred_to_the_state_of_its_rotation():
    """Its lag frequency is about omega sqrt(3 e/2 L), e the radius of the hinge."""
    def modes(about):
        stiff = {"EA": 1e6, "kGA": 1e6, "EI": 1e3, "rhoA": 1.0, "rhoI": 1e-4}
        blade = helpers.body(helpers.line(1.0), helpers.element("reissner3", 4), stiff)
        return helpers.load({"blade": blade}, {"type": "eigen", "modes": 1, "about": about},
                            bc=[{"type": "pin", "at": "blade@0"}], steady_rotation={"omega": 10, "about": [-0.1, 0]})

    with pytest.raises(CaseError) as caught:
        ancf2d.solve(modes("static"))
    assert "about: reference if the rotation of the frame holds it" in str(caught.value)
    (lag,) = ancf2d.solve(modes("reference")).summary["frequencies"]
    assert lag["omega"] == pytest.approx(10 * math.sqrt(0.15), rel=0.01)


def test_the_pole_of_two_rollers_is_the_intersection_of_their_normals():
    bc = [{"type": "roller", "at": "a@0", "fixed": "y"}, {"type": "roller", "at": "a@1", "normal": [1, 1]}]
    with pytest.raises(CaseError, match=r"'a' is free to turn about \(0, -1\)"):
        scene("reissner3", bc)


def test_arc_on_rollers_towards_its_centre_is_a_mechanism():
    arc = {"type": "arc", "center": [0, 0], "radius": 1.0, "from": 0.0, "to": 3.0}
    from math import cos, sin

    bodies = {"a": helpers.body(arc, helpers.element("vallejo", 8))}
    bc = [{"type": "roller", "at": f"a@{s}", "normal": [cos(3 * s), sin(3 * s)]} for s in (0, 0.5, 1)]
    with pytest.raises(CaseError, match=r"turn about \(0, 0\)"):
        helpers.build(bodies, bc=bc)


@pytest.mark.parametrize("end", [[0.097, 0.0262], [0.3, 0.1], [0.1, 0.4]])
def test_a_torsion_spring_within_a_rigid_body_prevents_nothing(end: list[float]) -> None:
    """The round-off of its stiffness is no support: the bar would turn by 1e33 rad."""
    bar = {"geometry": {"type": "line", "start": [0.182, 0.031], "end": end}, "element": {"type": "rigid"}}
    spring = {"type": "rotational", "between": ["a@0.25", "a@0.5"], "stiffness": 0.015}
    with pytest.raises(CaseError, match="'a' is free to turn about"):
        helpers.build({"a": bar}, "static", bc=[PIN0], springs=[spring])


@pytest.mark.parametrize("name", NAMES)
def test_closing_a_ring_prevents_no_rotation(name):
    # where a gradient of the closing section has a component of zero, the rate of the other one is round-off alone
    circle = {"type": "curve", "x": "cos(2*pi*s)", "y": "sin(2*pi*s)", "closed": True}
    bodies = {"a": helpers.body(circle, helpers.element(name, 16))}
    with pytest.raises(CaseError, match=r"'a' is free to turn about \(1, 0\)"):
        helpers.build(bodies, "static", bc=[PIN0])
