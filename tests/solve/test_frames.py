"""Frames with many loops, by the multifrontal method, compared with another program's Timoshenko beams."""

from __future__ import annotations

import helpers as h
import pytest

from ancf2d.solvers.registry import solve
from ancf2d.solvers.state_results import Observer

SIDE = 10
# displacement of the corner: linear, ElasticTimoshenkoBeam of OpenSees 3.7.1 (openseespy), one element a member,
# shear factor 10 (1 + nu)/(12 + 11 nu)
OPENSEES = (0.011000735972089188, -0.011075087169628172)


@pytest.mark.slow
def test_a_lattice_bends_as_in_another_program() -> None:
    """10 x 10 nodes 1 m apart, steel 50 mm x 50 mm, clamped at one corner, 100 N down at the opposite one."""
    section, spec = {"height": 0.05, "width": 0.05}, h.element("reissner3", 2)
    material = {"E": 2.07e11, "nu": 0.3, "rho": 7850.0}
    n, bodies, meeting = range(SIDE), {}, {}
    ends = [((i, j), (i + 1, j)) for i in n[:-1] for j in n] + [((i, j), (i, j + 1)) for i in n for j in n[:-1]]
    for k, pair in enumerate(ends):
        line = {"type": "line", "start": list(pair[0]), "end": list(pair[1])}
        bodies[f"m{k}"] = h.body(line, spec, section, material)
        for s, place in enumerate(pair):
            meeting.setdefault(place, []).append(f"m{k}@{s}")
    corner = meeting[SIDE - 1, SIDE - 1][0]
    model = h.build(bodies, {"type": "linear_static"}, bc=[{"type": "clamp", "at": meeting[0, 0][0]}],
                    joints=[{"type": "weld", "between": found} for found in meeting.values()],
                    loads=[{"type": "force", "at": corner, "value": [0, -100]}], output={"probes": {"tip": corner}})
    assert model.numbering.fronts is not None
    *_, state = solve(model)
    found = Observer(model).observe(state)["tip"]
    assert (found["ux"], found["uy"]) == pytest.approx(OPENSEES, rel=1e-8)
