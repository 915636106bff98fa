"""Collisions and friction of bodies in motion: momentum, energy and restitution."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import helpers
import numpy as np
import pytest
from motions import ride
from test_contact_of_bodies import LAWS, SECTION, clamps

import ancf2d
from ancf2d.errors import ComputationError
from ancf2d.interactions.body_contact import BodyPair
from ancf2d.solvers.contact import check_pressed_through


@pytest.mark.parametrize("law", helpers.chosen(LAWS, ["none"]))
def test_a_bar_passes_its_velocity_to_an_equal_one(law):
    count, v = 6, 0.01
    section = {"EA": 1.0, "EI": 1e-4, "kGA": 0.3, "rhoA": 1.0, "rhoI": 1e-4}

    def bar(x):
        return helpers.body({"type": "line", "start": [x, 0], "end": [x + 1, 0]},
                            helpers.element("reissner2", count), section)

    given = {"law": {"stiffness": 100.0}} if law == "law" else {}
    found = ride({"bodies": {"one": bar(0.0), "two": bar(1.002)}, "contacts": [{"between": ["one", "two"], **given}],
                  "initial": {"bodies": {"one": {"velocity": [v, 0]}}}},
                 2.7, dt=0.1 / count, every=1, method="generalized_alpha")
    total, momenta = found.totals()
    np.testing.assert_allclose(momenta, momenta[0] * np.ones_like(momenta), atol=1e-13 * v)
    # a wave that returns from the free ends lets them part: the one that hit is at rest (e.g. Goldsmith, Impact)
    _, rates, _ = found.full()
    mean = {}
    for name, mesh in found.model.meshes.items():
        at = [helpers.dot(helpers.point_ref(mesh, k / count).position()[0], rates) for k in range(count + 1)]
        mean[name] = (sum(at) - 0.5 * (at[0] + at[-1])) / count
    assert mean["one"] / v == pytest.approx(0.0, abs=0.08)
    assert mean["two"] / v == pytest.approx(1.0, abs=0.08)
    # but for waves as short as the elements, which steps damp; without a law the first nodes stop one another
    assert total[-1] == pytest.approx(total[0], rel=0.04 if law == "none" else 0.01)
    if law == "none":
        assert total.max() <= total[0] * (1 + 1e-12)
        assert found.rows[-1].lost == pytest.approx(total[0] - total[-1], rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["RK45", "DOP853", "BDF", "LSODA", "radau9"])
def test_methods_for_differential_equations_keep_momentum_and_account_for_energy_in_a_collision(method):
    section = {"EA": 1.0, "EI": 1e-2, "kGA": 0.3, "rhoA": 1.0, "rhoI": 1e-2}
    one, two = (helpers.body(helpers.line(1.0, start=(x, 0.0)), helpers.element("reissner2", 1), section)
                for x in (0.0, 1.02))
    law = {"stiffness": 10.0, "damping": 0.3}
    found = ride({"bodies": {"one": one, "two": two}, "contacts": [{"between": ["one", "two"], "law": law}],
                  "initial": {"bodies": {"one": {"velocity": [0.1, 0]}}}}, 3.0, tolerance=1e-7, every=1, method=method)
    total, momenta = found.totals()
    np.testing.assert_allclose(momenta, momenta[0] * np.ones_like(momenta), atol=1e-8)
    took = np.array([row.lost for row in found.rows])
    np.testing.assert_allclose(total + took, total[0], rtol=1e-3)
    assert took[-1] > 1e-3 * total[0]
    assert max(abs(row.work) for row in found.rows) < 1e-9


@pytest.mark.slow
def test_a_block_that_slides_and_chatters_on_a_plank_gains_no_energy():
    """A force that generalized-alpha keeps in the step of its release would do 0.5 % of work on separating bodies."""
    alu = {"E": 7e10, "nu": 0.3, "rho": 2700.0}
    bodies = {"plank": helpers.body(helpers.line(1.0), helpers.element("cable", 8), SECTION, alu),
              "block": helpers.body({"type": "line", "start": [0.2, 0.021], "end": [0.4, 0.021]},
                                    helpers.element("cable", 4), SECTION, alu)}
    energy = ancf2d.solve({
        "bodies": bodies, "contacts": [{"between": ["block", "plank"]}],
        "boundary_conditions": clamps("plank@0", "plank@1"), "loads": [{"type": "gravity", "value": [0, -9.81]}],
        "initial": {"bodies": {"block": {"velocity": [1.0, 0]}}}, "output": {"every": 1},
        "solver": {"type": "dynamic", "t_end": 0.02, "tolerance": 1e-4}}).energies
    total = sum(energy[part] for part in ("kinetic", "strain", "potential", "dissipated"))
    assert energy["dissipated"][-1] > 1e-3
    assert total.max() < 0.27 * (1.0 + 5e-4)
    assert total.min() > 0.27 * (1.0 - 1e-2)


def block(start: Any, end: Any) -> dict[str, Any]:
    """Return a rigid bar of 2 kg per metre."""
    return {"geometry": {"type": "line", "start": list(start), "end": list(end)}, "element": {"type": "rigid"},
            "section": {"height": 0.1, "width": 0.1}, "material": {"E": 1e9, "nu": 0.3, "rho": 200.0}}


def thrown(velocity: tuple[float, float], one: Any, two: Any, **contact: Any) -> dict[str, Any]:
    return {"bodies": {"one": block(*one), "two": block(*two)}, "contacts": [{"between": ["one", "two"], **contact}],
            "initial": {"bodies": {"one": {"velocity": list(velocity)}}}}


@pytest.mark.parametrize("restitution", [0.5, 1.0])
def test_restitution_is_that_of_two_bodies(restitution):
    found = ride(thrown((1.0, 0.0), ([0, 0], [1, 0]), ([1.2035, 0], [2.2035, 0]), restitution=restitution),
                 0.5, dt=0.01, method="generalized_alpha")
    _, rates, _ = found.full()
    at = [helpers.dot(helpers.point_ref(mesh, 0.5).position()[0], rates) for mesh in found.model.meshes.values()]
    # of equal masses
    np.testing.assert_allclose(at, [0.5 * (1 - restitution), 0.5 * (1 + restitution)], atol=1e-9)
    assert found.rows[-1].lost == pytest.approx(0.5 * (1 - restitution**2), abs=1e-9)


@pytest.mark.slow
def test_the_augmentation_constant_has_no_effect(monkeypatch):
    """The constant c of Alart & Curnier, 1 N/m for rigid bodies: the same motion with 1e-6 and 1e6 times as much."""
    ways, own = [], BodyPair._law
    aslant = thrown((1.0, -0.3), ([0, 0.3], [1, 0.3]), ([1.2035, 0], [2.2035, 0.2]), restitution=0.5)
    lying = {**thrown((0.0, -1.0), ([0, 0.3], [1, 0.3]), ([-1, 0], [2, 0])),
             "bc": clamps("two@0"), "loads": [{"type": "gravity", "value": [0, -9.81]}]}
    for factor in (1.0, 1e-6, 1e6):
        def law(pair, spot, factor=factor):
            weight, c, *rest = own(pair, spot)
            return weight, factor * c, *rest

        monkeypatch.setattr(BodyPair, "_law", law)
        found = [ride(scene, 0.5, dt=0.01, method="generalized_alpha") for scene in (aslant, lying)]
        assert all(one.rows[-1].lost > 0.01 for one in found)
        ways.append(np.concatenate([one.full()[0] for one in found]))
    np.testing.assert_allclose(ways[1], ways[0], atol=1e-10)
    np.testing.assert_allclose(ways[2], ways[0], atol=1e-10)


@pytest.mark.parametrize("dt", [0.3, 0.02])
@pytest.mark.parametrize(("velocity", "x"), [((0.0, -50.0), 0.25), ((150.0, -50.0), -3.0)], ids=["straight", "aslant"])
def test_bodies_do_not_pass_through_one_another_in_long_steps(velocity, x, dt):
    # aslant, it is beside the other neither at the start of the long step nor at its end
    found = ride(thrown(velocity, ([x, 0.5], [x + 1, 0.5]), ([-1, -0.5], [2, -0.5]), restitution=1.0), 0.3, dt=dt,
                 every=1, method="generalized_alpha")
    total, momenta = found.totals()
    assert total.max() <= total[0] * (1 + 1e-9)
    assert np.abs(np.diff(momenta[:, :2], axis=0)).max() < 1e-9 * np.abs(momenta).max()
    # it has hit the other from above
    _, rates, _ = found.full()
    assert helpers.dot(helpers.point_ref(found.model.meshes["two"], 0.5).position()[1], rates) < -1.0
    assert found.place("one@0.5")[1] > found.place("two@0.5")[1]


def test_corners_that_supports_hold_on_each_other_do_not_touch():
    """Their gap is round-off, and would begin and end contact in ever shorter steps."""
    def leaf(y: float, length: float) -> dict[str, Any]:
        return helpers.body(helpers.line(length, start=(0.0, y)), helpers.element("reissner3", 4),
                            {"height": 0.01, "width": 0.05}, {"E": 1e8, "nu": 0.3, "rho": 1000})

    found = ancf2d.solve({
        "bodies": {"long": leaf(0.01, 1.0), "short": leaf(0.0, 0.6)},
        "boundary_conditions": [{"type": "clamp", "at": "long@0"}, {"type": "clamp", "at": "short@0"}],
        "loads": [{"type": "force", "at": "long@1", "value": [0, -0.1], "amplitude": {"type": "ramp", "t1": 0.05}}],
        "contacts": [{"between": ["long", "short"], "law": {"stiffness": 1e7, "damping": 100}}],
        "solver": {"type": "dynamic", "t_end": 0.01, "tolerance": 1e-4, "estimate": False}})
    assert found.summary["steps"] < 300


@pytest.mark.parametrize(("hard", "advice"), [(True, "more elements"), (False, "a stiffer law or none")])
def test_overlapping_bodies_give_advice(hard: bool, advice: str) -> None:
    """A contact without a law gets no advice on laws."""
    pair = SimpleNamespace(hard=hard, on_bodies=True, mesh="a", against="a", pressed_through=lambda d: "a is deep in b")
    with pytest.raises(ComputationError, match="where contact may no longer hold it") as found:
        check_pressed_through(SimpleNamespace(contact_tables=[SimpleNamespace(pair=pair)]), np.zeros(1), {"t": 0.1})
    assert found.value.failure.advice.startswith(advice)
