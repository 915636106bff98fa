"""Values right at a limit: the last one that is allowed, and the first one that is not."""

from math import pi
from pathlib import Path

import pytest

from ancf2d.case import load_case
from ancf2d.errors import CaseError

VALID = Path(__file__).parent / "valid"
CIRCLE = "{{type: arc, center: [0, 0], radius: 1, from: 0, to: {}}}"


@pytest.mark.parametrize(("name", "path", "allowed", "refused"), [
    ("frame", "bodies.beam.element.count", "2", "1"),
    ("frame", "bodies.hanger.geometry", CIRCLE.format(2 * pi), CIRCLE.format(6.2832)),
    ("frame", "bodies.hanger.geometry", CIRCLE.format(-2 * pi), CIRCLE.format(-6.2832)),
    ("frame", "bodies.column.element.order", "[8, 5]", "[9, 5]"),
    ("frame", "bodies.column.element.quadrature", "[20, 1]", "[21, 1]"),
    ("frame", "bodies.column.material.nu", "0.4999999", "0.5"),
    ("frame", "bodies.column.material.nu", "-0.9999999", "-1"),
    ("frame", "bodies.column.section.height", "1e-300", "0"),
    ("frame", "loads.0.at", "beam@1", "beam@1.0000000001"),
    ("frame", "loads.0.at", "beam@0", "beam@-1e-300"),
    ("frame", "loads.snow.from", "0.9999", "1"),
    ("frequencies", "goal.number", "20", "21"),
    ("column", "goal.load_factor", "3", "4"),
    ("lee_frame", "goal.limit_point", "2", "3"),
    ("spin_up", "solver.dt", "20", "20.001"),
    ("spin_up", "solver.dt", "2.1e-11", "1.9e-11"),
    ("pendulum", "solver.tolerance", "0.9", "1"),
])
def test_limit(name, path, allowed, refused, vocabulary):
    load_case(VALID / f"{name}.yaml", [f"{path}={allowed}"], vocabulary)
    with pytest.raises(CaseError):
        load_case(VALID / f"{name}.yaml", [f"{path}={refused}"], vocabulary)
