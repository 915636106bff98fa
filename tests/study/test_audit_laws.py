"""Laws of materials pass the audit in each formulation that supports them, and broken ones are detected."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ancf2d.study.audit import laws
from ancf2d.study.audit.examine import LAW_CHECKS, audit
from ancf2d.study.audit.subject import subject


@pytest.mark.parametrize(("name", "formulation", "told"), [
    ("reissner2", None, "viscoelastic, yield, curve"),
    pytest.param("cable", None, "viscoelastic, yield, curve", marks=pytest.mark.slow),
    pytest.param("vallejo", "structural", "viscoelastic, yield, curve", marks=pytest.mark.slow),
    pytest.param("2d3n-nu", "continuum", "viscoelastic, neo_hooke", marks=pytest.mark.slow)])
def test_laws_pass_in_the_formulations_that_support_them(name: str, formulation: str | None, told: str) -> None:
    found = audit(subject(name, None, formulation), LAW_CHECKS).results
    assert [a.check.name for a in found] == [c.name for c in LAW_CHECKS]
    for answer in found:
        assert answer.finding.verdict == "pass", answer.finding
        assert f"({told})" in answer.finding.meaning


def test_broken_laws_are_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tangent with an error of 1e-4, too much stored energy, forces that do not turn, growing loss."""
    s = subject("reissner2")
    known: Any = laws.to_sparse
    monkeypatch.setattr(laws, "to_sparse", lambda *a: 1.0001 * known(*a))
    assert laws.law_tangent(s).verdict == "fail"
    monkeypatch.setattr(laws, "rigidly_moved", lambda model, d, angle: d)
    assert laws.law_objectivity(s).verdict == "fail"
    energy: Any = laws.extra_energy
    monkeypatch.setattr(laws, "extra_energy", lambda *a: 1.5 * np.array(energy(*a)))
    assert laws.law_dissipation(s).verdict == "fail"
    monkeypatch.setattr(laws, "CYCLES", 2)
    assert laws.law_cycles(s).verdict == "fail"
