"""Sections: equivalent rectangles, areas and stiffnesses; impossible rectangles are refused."""

import helpers
import numpy as np
import pytest

from ancf2d.elements.section import timoshenko
from ancf2d.errors import CaseError

H, B, E, NU, RHO = 0.2, 0.1, 3.0e6, 0.25, 7.0
A, I, G = H * B, B * H**3 / 12, E / (2 * (1 + NU))


def plan(name: str, section: dict, formulation: str | None = None, **more):
    spec = helpers.element(name, 2, formulation, **more)
    beam = {"b": helpers.body(helpers.LINE, spec, section, {"E": E, "nu": NU, "rho": RHO})}
    return helpers.build(beam, bc=[{"type": "clamp", "at": "b@0"}]).meshes["b"].plan.section


@pytest.mark.parametrize("name", helpers.TYPES)
def test_a_rectangle_has_its_stiffnesses_and_inertias(name):
    s = plan(name, {"height": H, "width": B})
    np.testing.assert_allclose([s.EA, s.EI, s.rhoA, s.rhoI], [E * A, E * I, RHO * A, RHO * I], rtol=1e-14)
    chosen = helpers.TYPES[name].shear_factor
    k = {"timoshenko": timoshenko(NU), "none": 1.0}.get(chosen, chosen)
    assert s.kGA == pytest.approx(k * G * A, rel=1e-14)
    assert s.mu_k == pytest.approx(k * G, rel=1e-14)


@pytest.mark.parametrize(("given", "k"), [("timoshenko", 12.5 / 14.75), ("none", 1.0), (0.7, 0.7)])
@pytest.mark.parametrize("name", ["vallejo", "reissner3", "ancf[3,3]"])
def test_the_shear_factor_may_be_chosen(name, given, k):
    assert plan(name, {"height": H, "width": B}, shear_factor=given).kGA == pytest.approx(k * G * A, rel=1e-14)


def test_the_cable_refuses_a_shear_factor():
    with pytest.raises(CaseError, match="has no shear"):
        plan("cable", {"height": H, "width": B}, shear_factor=0.8)


@pytest.mark.parametrize("name", helpers.TYPES)
def test_area_and_second_moment_stand_for_their_rectangle(name):
    s = plan(name, {"A": A, "I": I, "height": 0.5})
    np.testing.assert_allclose([s.EA, s.EI, s.rhoA, s.rhoI], [E * A, E * I, RHO * A, RHO * I], rtol=1e-14)
    if helpers.TYPES[name].section_kind == "interpolated":
        np.testing.assert_allclose([s.height, s.width], [H, B], rtol=1e-14)


@helpers.every_small_variant
def test_stiffnesses_describe_the_same_beam_as_their_rectangle(name, formulation):
    """Without Poisson's ratio, which stiffnesses do not contain; a square has any width."""
    k = 0.8
    square = {"height": H, "width": H}
    stiffness = {"EA": E * H * H, "kGA": k * E / 2 * H * H, "EI": E * H**4 / 12, "rhoA": RHO * H * H}
    more = {} if helpers.TYPES[name].section_kind == "tangent" else {"shear_factor": k}
    material = {"E": E, "nu": 0.0, "rho": RHO}
    tips = []
    for section, options in ((square, more), (stiffness, {})):
        spec = helpers.element(name, 3, formulation, **options)
        loads = [*helpers.tip(0.0, -2.0), {"type": "gravity", "value": [0.0, -9.81]}]
        tips.append(helpers.cantilever(spec, loads, section=section, material=material).u("beam@1"))
    np.testing.assert_allclose(tips[1], tips[0], rtol=1e-9)


def test_stiffnesses_of_no_rectangle_are_refused_by_types_with_a_section():
    good = {"EA": 1e4, "kGA": 4e3, "EI": 1.0, "rhoA": 2.0, "rhoI": 2e-4}
    plan("vallejo", good)
    with pytest.raises(CaseError, match="rhoI"):
        plan("vallejo", {**good, "rhoI": 1e-3})
    with pytest.raises(CaseError, match="kGA"):
        plan("vallejo", {**good, "kGA": 6e3})
    # the structural form and the beams on the axis take stiffnesses as they are
    assert plan("vallejo", {**good, "kGA": 6e3}, "structural").kGA == 6e3
    assert plan("reissner3", {**good, "kGA": 6e3, "rhoI": 1e-3}).rhoI == 1e-3
    assert plan("cable", {"EA": 1e4, "EI": 1.0}).EI == 1.0
    with pytest.raises(CaseError, match="kGA"):
        plan("reissner3", {"EA": 1e4, "EI": 1.0})


@pytest.mark.parametrize(("element", "solver", "told"), [
    ("reissner3", {"type": "dynamic", "t_end": 1}, True), ("cable", {"type": "dynamic", "t_end": 1}, False),
    ("reissner3", {"type": "eigen", "modes": 1}, False)])
def test_sections_without_rotary_inertia_have_modes_but_no_motion(element, solver, told):
    body = {"geometry": helpers.line(1.0), "section": {"EA": 1e4, "kGA": 1e4, "EI": 2.0, "rhoA": 3.0, "rhoI": 0.0},
            "element": {"type": element, "count": 2}}
    scene = {"bodies": {"b": body}, "solver": solver, "bc": [{"type": "clamp", "at": "b@0"}]}
    if told:
        with pytest.raises(CaseError, match=r"section.rhoI is 0, .* rhoA EI/EA = 0\.0006, or type cable"):
            helpers.build(**scene)
    else:
        assert helpers.build(**scene).n_q > 0
