"""Elements divided among threads: the parts are disjoint, and bits do not depend on the number of threads."""

import helpers
import numpy as np
import pytest

from ancf2d.solvers import divided_groups
from ancf2d.solvers.system import System

ROUND = {"type": "arc", "center": [0, 0], "radius": 1.0, "from": 0, "to": 2 * np.pi}
LINE = {"type": "line", "start": [0, 0], "end": [2, 0]}


def system_of(monkeypatch, wanted: int, shape=LINE, count: int = 40, name: str = "vallejo", **more) -> System:
    monkeypatch.setattr(divided_groups, "PART", 8)
    monkeypatch.setenv("OMP_NUM_THREADS", str(wanted))
    bodies = {"b": helpers.body(shape, helpers.element(name, count))}
    return System(helpers.build(bodies, bc=[{"type": "clamp", "at": "b@0"}], **more))


@pytest.mark.parametrize("name", [v[0] for v in helpers.DEFAULTS])
def test_bits_are_the_same_for_any_number_of_threads(monkeypatch, name):
    found = []
    for wanted in (1, 2, 3):
        system = system_of(monkeypatch, wanted, name=name)
        assert (system.divided.pool is None) == (wanted == 1)
        assert [len(stage) for stage in system.divided.stages] == [5, 1]
        d = helpers.random_state(system.model, 1e-3)
        balance = system.assemble(d, 1.0)
        found.append((balance.R, balance.energy, system.matrix.values.copy(), system.forces(d, 1.0).R,
                      system.action(d, d, 1.0), system.noise(d, 1.0)))
    for other in found[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found[0], other, strict=True))


def test_parts_add_up_to_the_whole(monkeypatch):
    parted = system_of(monkeypatch, 2)
    monkeypatch.setattr(divided_groups, "PART", 1000)
    whole = System(parted.model)
    assert [len(stage) for stage in whole.divided.stages] == [1]
    d = helpers.random_state(parted.model, 1e-3)
    a, b = parted.assemble(d, 1.0), whole.assemble(d, 1.0)
    assert a.energy == pytest.approx(b.energy, rel=1e-14)
    np.testing.assert_allclose(a.R, b.R, atol=1e-13 * np.abs(b.R).max())
    np.testing.assert_allclose(parted.matrix.values, whole.matrix.values,
                               atol=1e-14 * np.abs(whole.matrix.values).max())


@pytest.mark.parametrize("shape", [LINE, ROUND])
def test_parts_are_disjoint(monkeypatch, shape):
    system = system_of(monkeypatch, 2, shape)
    place = system.model.numbering.place
    for stage in system.divided.stages[:1]:
        unknowns = [set(place[part.dofs.ravel()]) - {-1} for part in stage]
        assert all(a.isdisjoint(b) for i, a in enumerate(unknowns) for b in unknowns[:i])
    assert sum(len(part.dofs) for stage in system.divided.stages for part in stage) == 40


def test_bodies_whose_ends_share_unknowns_are_not_divided(monkeypatch):
    """A weld makes the coordinates of the last node combinations of those of the first."""
    monkeypatch.setattr(divided_groups, "PART", 8)
    ring = {"b": helpers.body(ROUND, helpers.element("vallejo", 40))}
    model = helpers.build(ring, joints=[{"type": "weld", "between": ["b@0", "b@1"]}],
                          bc=[{"type": "clamp", "at": "b@0.5"}])
    assert [len(stage) for stage in System(model).divided.stages] == [1]
