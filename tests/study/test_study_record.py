"""Values read from the states of a run: probes only if a file or a goal over a window of time needs them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ancf2d.case import load_case_text
from ancf2d.solvers.state_results import Observer
from ancf2d.study.run import run_case, vocabulary

STATES = 11
FALLING = """
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {height: 0.1, width: 0.1}
    material: {E: 1e7, nu: 0.3, rho: 1000}
    element: {type: reissner2, count: 2}
boundary_conditions: [{type: pin, at: rod@0}]
loads: [{type: gravity, value: [0, -9.81]}]
solver: {type: dynamic, t_end: 0.1, dt: 0.01, estimate: false}
output: {probes: {tip: rod@1}}
"""
MEAN = FALLING + "goal: {probe: tip, quantity: uy, mean_over: [0, 0.1]}\n"


@pytest.mark.parametrize(("case", "out", "reads"), [(FALLING, None, 1), (MEAN, None, STATES),
                                                    (FALLING, "out.h5", STATES)], ids=["end", "window", "file"])
def test_probes_are_read_only_for_a_window_or_a_file(case: str, out: str | None, reads: int, tmp_path: Path,
                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    read, times = Observer.observe, list[float]()

    def observe(self: Observer, state: Any) -> dict[str, dict[str, float]]:
        times.append(state.t)
        return read(self, state)

    monkeypatch.setattr(Observer, "observe", observe)
    found = run_case(load_case_text(case, vocabulary=vocabulary()), None if out is None else str(tmp_path / out))
    assert len(times) == reads
    assert times[-1] == pytest.approx(0.1)
    # a free fall about the pin at first: the tip falls by 3/4 g t^2, less what the turn takes away
    assert found.summary["probes"]["tip"]["uy"] == pytest.approx(-0.0735, rel=0.01)
