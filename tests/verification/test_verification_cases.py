"""Every case in ``cases/`` compared with its expected values and stored outputs; new cases are included."""

from __future__ import annotations

import re
from collections import deque
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import stored_outputs

from ancf2d.case import json_schema
from ancf2d.case.compose import compose
from ancf2d.case.nodes import Origin, plain_data
from ancf2d.solvers.state import State
from ancf2d.solvers.state_results import unbalanced_forces
from ancf2d.study.record import Progress
from ancf2d.study.run import load, run_case, vocabulary
from scripts import make_docs, verification_manual

CASES = Path(__file__).parents[2] / "cases"
FILES = sorted(CASES.rglob("*.yaml"))
MANUAL = (CASES.parent / "docs" / "verification.md").read_text(encoding="utf-8")
HEADING = re.compile(r"^###? .*$", re.M)
# of meshes and element types of the same motion the quick tests take one
QUICK = ("double_pendulum", "four_bar", "free_rod", "pendulum1_2d3n_4", "pendulum2_2d2n_4", "slider_crank_rigid",
         "caught_rod", "pid_arm")
# what takes long, of which a quick test has the closed form or the published value: belts (test_contact_statics), ropes
# (test_hanging), strips, shared forces (test_contact_of_bodies), pipes (test_flow), leaves that rub
# (test_friction_between_bodies), columns (test_flutter), Lee's frame (of the other element here)
DEAR = ("leaf_spring", "two_pulleys", "hanging_catenary", "sliding_strip", "lifted_strip", "shared_force",
        "cantilever_pipe_heavy", "cantilever_pipe_light", "cantilever_pipe", "beck_kelvin_voigt", "lee_frame_vallejo")


def named(case: Path, quick: bool) -> Any:
    """Return a case as a parameter by its name."""
    return pytest.param(case, id=str(case.relative_to(CASES).with_suffix("")), marks=() if quick else pytest.mark.slow)


EVERY = pytest.mark.parametrize("case", [named(f, True) for f in FILES])
SOLVED = pytest.mark.parametrize("case", [
    named(f, f.stem not in DEAR and (f.parent.name != "dynamic" or f.stem in QUICK)) for f in FILES])
# one solution of the linear equations of 128 slender elements loses this much to round-off; all pairs of a stiff matrix
# at once as much as they differ where the same beam lies at another angle
ROUND_OFF = {"fig4_linear_2d2n": 1e-7, "fig4_linear_2d3n": 1e-5, "rotating_cantilever_vallejo": 5e-9,
             # where two frequencies meet, they change like a square root
             "beck": 1e-6, "beck_kelvin_voigt": 1e-6, "leipholz": 1e-6,
             # EA is 1e14 EI/L^2, so that the weight is balanced to 1e-6; drawn at another angle, the same chain has
             # frequencies that differ by 2e-7
             "hanging_chain": 1e-6}
# steps of a motion are chosen by estimates whose last digits are round-off
MOTION = 1e-5


@cache
def run(case: Path) -> tuple[dict[str, Any], float]:
    """Return the summary of a case, and the forces that its last state leaves unbalanced."""
    states: deque[State] = deque(maxlen=1)
    outcome = run_case(load(case), progress=Progress(state=states.append))
    moves = outcome.summary["solver"] == "dynamic"
    return outcome.summary, 0.0 if moves or not states else unbalanced_forces(outcome.model, states[0])


def solved(case: Path) -> dict[str, Any]:
    return run(case)[0]


@SOLVED
def test_expected_values_are_met(case: Path) -> None:
    summary = solved(case)
    assert summary["status"] == "converged", summary.get("reason")
    assert len(summary["checks"]) == len(load(case).case.expected) > 0
    missed = [f"{c['what']}: {c['value']!r} instead of {c['expected']!r} ({c['source']}), "
              f"off by {c['difference']:.3g}, allowed {c['allowed']:.3g}" for c in summary["checks"] if not c["met"]]
    assert not missed, "\n".join(missed)


@SOLVED
def test_a_case_meets_its_tolerance(case: Path) -> None:
    assert not [w for w in solved(case)["warnings"] if "tolerance is missed" in w]


@SOLVED
def test_outputs_are_the_stored_ones(case: Path, request: pytest.FixtureRequest) -> None:
    file, now = stored_outputs.path(case, CASES), stored_outputs.outputs(solved(case))
    if request.config.getoption("--update"):
        stored_outputs.write(file, now)
    assert file.exists(), f"{file.name} is missing: pytest --update writes it"
    rtol = MOTION if solved(case)["solver"] == "dynamic" else ROUND_OFF.get(case.stem, stored_outputs.RTOL)
    found = stored_outputs.differences(now, stored_outputs.read(file), rtol, run(case)[1])
    assert not found, f"{len(found)} values deviate, the worst first:\n" + "\n".join(found[:5])


@SOLVED
def test_its_section_of_the_verification_manual_is_current(case: Path) -> None:
    name = case.relative_to(CASES).with_suffix("").as_posix()
    shown = re.search(rf"^### {name}\n.*?(?=\n###? |\Z)", MANUAL, re.M | re.S)
    assert shown, name
    # two texts that differ are not compared by pytest, which would take minutes
    current = make_docs.same(shown[0], verification_manual.section(verification_manual.verified(case, solved)))
    assert current, "run: python -m scripts.make_docs"


def test_the_rest_of_the_verification_manual_is_current() -> None:
    """The text before the first section, with the numbers of cases and references, and the order of the sections."""
    def counted(case: Path) -> dict[str, Any]:
        return {"checks": [dict.fromkeys(("what", "source"), "") | {"expected": 1.0, "value": 1.0, "difference": 0.0,
                                                                   "allowed": 1.0, "met": True}
                           for _ in load(case).case.expected]}

    made = verification_manual.manual(counted)
    assert MANUAL.partition("\n## ")[0] == made.partition("\n## ")[0]
    assert HEADING.findall(MANUAL) == HEADING.findall(made)


@pytest.fixture(scope="module")
def validator() -> Any:
    """Return the validator of the schema of cases."""
    schema = json_schema(vocabulary())
    kind = jsonschema.validators.validator_for(schema)
    kind.check_schema(schema)
    return kind(schema)


@EVERY
def test_case_follows_the_json_schema(case: Path, validator: Any) -> None:
    validator.validate(plain_data(compose(case.read_text(encoding="utf-8"), Origin(case.name, []))))


@EVERY
def test_case_has_a_description_and_sources(case: Path) -> None:
    loaded = load(case)
    assert loaded.case.title
    assert loaded.case.goal
    assert loaded.case.output.probes
    assert loaded.text.startswith("# "), "a case begins with a comment that says what it shows"
    assert all(e.source for e in loaded.case.expected)


def test_no_stored_output_is_left_over() -> None:
    known = {stored_outputs.path(f, CASES) for f in FILES}
    assert not [f for f in stored_outputs.STORED.rglob("*.json") if f not in known]


def test_a_deviation_is_reported_worst_first() -> None:
    old = {"dofs": 6, "probes": {"tip": {"x": 1.0, "ux": 1e-3, "theta": 0.0}}}
    new = {"dofs": 6, "probes": {"tip": {"x": 1.0 + 1e-7, "ux": 2e-3, "theta": 1e-15}}}
    found = stored_outputs.differences(new, old)
    assert [line.split(":")[0] for line in found] == ["probes.tip.ux", "probes.tip.x"]
    assert stored_outputs.differences(dict(new, dofs=7), old)[0].startswith("dofs")


def test_forces_below_the_residual_are_round_off() -> None:
    old = {"reactions": {"wall": {"fx": 1e-12, "m": 0.0}}, "energy": {"strain": 1e-28}}
    new = {"reactions": {"wall": {"fx": -1e-12, "m": 1e-13}}, "energy": {"strain": 2e-28}}
    assert len(stored_outputs.differences(new, old)) == 3
    assert not stored_outputs.differences(new, old, unbalanced=2e-12)
    new["reactions"]["wall"]["fx"] = 1e-11
    [line] = stored_outputs.differences(new, old, unbalanced=2e-12)
    assert line.startswith("reactions.wall.fx")
