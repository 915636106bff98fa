"""Linear models of small motions: static gain, transfer functions, step responses, export, control design."""

from __future__ import annotations

import copy
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import scipy.linalg
from scipy.sparse.linalg import splu

from ancf2d.case import load_case_text
from ancf2d.errors import CaseError
from ancf2d.model.build import build_model
from ancf2d.results import open_results
from ancf2d.results.export import export
from ancf2d.solvers.small_motions.inputs_and_outputs import Inputs, outputs
from ancf2d.solvers.small_motions.linearised import Linearised, base_state
from ancf2d.study.run import run_case

OUTPUTS = ["tip.uy", "mid.ux", "mid.theta"]
SCENE: dict[str, Any] = {
    "bodies": {"beam": {"geometry": {"type": "line", "start": [0, 0], "end": [1, 0]},
                        "element": {"type": "reissner2", "count": 12}, "section": {"height": 0.02, "width": 0.02},
                        "material": {"E": 2e9, "nu": 0.3, "rho": 1000}}},
    "boundary_conditions": [{"name": "base", "type": "prescribed", "at": "beam@0", "ux": 0, "uy": 0.01, "angle": 0}],
    "loads": [{"name": "push", "type": "force", "at": "beam@1", "value": [0, -2]},
              {"name": "turn", "type": "moment", "at": "beam@0.5", "value": 1}],
    "springs": [{"type": "translational", "between": ["beam@1", [1, 1]], "stiffness": 8, "damping": 0.3}],
    "damping": {"rayleigh": {"alpha": 0.5, "beta": 1e-5}},
    "output": {"probes": {"tip": {"at": "beam@1"}, "mid": {"at": "beam@0.5", "y": 0.01}}},
    "solver": {"type": "state_space", "inputs": ["push", "turn"], "outputs": OUTPUTS, "modes": 6}}


def scene(drop: str = "", loads: Sequence[dict[str, Any]] = (), **solver: Any) -> dict[str, Any]:
    out = copy.deepcopy(SCENE)
    out.pop(drop, None)
    out["loads"] += loads
    out["solver"].update(solver)
    return out


def solved(case: dict[str, Any], path: Path) -> tuple[dict[str, Any], list[np.ndarray]]:
    found = run_case(load_case_text(json.dumps(case)), str(path), force=True)
    assert found.failure is None
    with open_results(path) as results:
        return found.summary, [results.array(f"state_space/{name}") for name in "ABCD"]


def transfer(system: list[np.ndarray], s: complex) -> np.ndarray:
    A, B, C, D = system
    return D + C @ np.linalg.solve(s * np.eye(len(A)) - A, B)


def direct(case: dict[str, Any], s: complex) -> np.ndarray:
    """The transfer function of all unknowns: (K + s C + s^2 M)^-1."""
    spec = case["solver"]
    model = build_model(load_case_text(json.dumps(case)))
    small = Linearised(base_state(model, spec.get("about", "reference")))
    rows = {f"{one.probe}.{one.quantity}": one for one in outputs(small)}
    factors = splu((small.K + s * small.C + s * s * small.M).tocsc())
    columns = []
    for one in Inputs(small)(spec["inputs"]):
        z, full = factors.solve(one.f[0] + s * one.f[1] + s * s * one.f[2]), one.p.astype(complex)
        for part, factor in ((z.real, 1.0), (z.imag, 1j)):
            d = np.zeros(len(full))
            model.numbering.expand(part, d)
            full += factor * d
        columns.append([s**np.arange(3) @ rows[name].contributions(full) for name in spec["outputs"]])
    return np.array(columns).T


# a turning force makes the tangent unsymmetric; without supports there are three rigid motions
JET = {"name": "jet", "type": "follower_force", "at": "beam@1", "value": [-1.5, 0.5]}
KINDS = {"loads": scene(), "motion": scene(inputs=["base", "push"]), "follower": scene(loads=[JET], about="static"),
         "follower on an overdamped end": {**scene(loads=[JET], about="static"), "springs": [
             {"type": "translational", "between": ["beam@1", [1, 1]], "stiffness": 8, "damping": 10}]},
         "motion beside a follower": scene(loads=[JET], about="static", inputs=["base", "push"]),
         "rotating frame": {**scene("boundary_conditions", about="static", inputs=["push"]),
                            "steady_rotation": {"omega": 5},
                            "boundary_conditions": [{"type": "clamp", "at": "beam@0"}]},
         "follower as input": scene(loads=[JET], inputs=["jet"])}


@pytest.mark.slow_rows("rotating frame")
@pytest.mark.parametrize("kind", KINDS)
def test_transfer_functions_are_those_of_all_unknowns(tmp_path: Path, kind: str) -> None:
    """The truncation error shrinks with the squared ratio of frequency to the first neglected mode."""
    case = KINDS[kind]
    _, system = solved(case, tmp_path / "a.h5")
    # the tip and its spring, and 6 bending modes up to 2500 rad/s
    for w, allowed in ((0.01, 1e-6), (10.0, 1e-3), (30.0, 2e-3), (100.0, 1e-2), (500.0, 5e-2)):
        wanted, found = direct(case, 1j * w), transfer(system, 1j * w)
        scale = np.abs(wanted).max(axis=1, keepdims=True)
        assert (np.abs(found - wanted) < allowed * scale).all(), (kind, w)


@pytest.mark.parametrize("loads", [[], [JET]])
def test_rates_are_those_of_the_modes(tmp_path: Path, loads: list[dict[str, Any]]) -> None:
    """They differ from s times the displacements by s times the static response of neglected modes, a constant."""
    about = "static" if loads else "reference"
    case = scene(outputs=["tip.uy", "mid.theta", "tip.vy", "mid.omega"], loads=loads, about=about, modes=8)
    _, system = solved(case, tmp_path / "a.h5")
    rests = []
    for s in (3j, 40j, 200j, 20 + 50j):
        found = transfer(system, s)
        rests.append(found[:2] - found[2:] / s)
    np.testing.assert_allclose(rests, np.broadcast_to(rests[0], np.shape(rests)), atol=1e-6 * np.abs(found[:2]).max())
    wanted = direct(case, 30j)[2:]
    assert (np.abs(transfer(system, 30j)[2:] - wanted).max(axis=1) < 2e-2 * np.abs(wanted).max(axis=1)).all()


@pytest.mark.parametrize("loads", [[], [JET]])
def test_velocities_under_prescribed_motions_have_the_rate_of_the_motion_as_an_input(
        tmp_path: Path, loads: list[dict[str, Any]]) -> None:
    """s times the displacement is the column of u plus s times that of u', exactly; compared with all unknowns."""
    case = scene(outputs=["tip.uy", "mid.theta", "tip.vy", "mid.omega"], inputs=["push", "base"], loads=loads,
                 about="static" if loads else "reference", modes=8)
    summary, system = solved(case, tmp_path / "a.h5")
    assert summary["state_space"]["inputs"] == ["push", "base", "base.rate"]
    assert system[1].shape[1] == system[3].shape[1] == 3
    for s in (3j, 40j, 20 + 50j, 30j):
        found = transfer(system, s)
        rates = found[2:, 1] + s * found[2:, 2]
        np.testing.assert_allclose(rates, s * found[:2, 1], rtol=1e-6)
        assert not found[:2, 2].any()
    wanted = direct(case, 30j)[2:, 1]
    assert np.abs(rates - wanted).max() < 1e-3 * np.abs(wanted).max()


def test_more_modes_have_smaller_errors(tmp_path: Path) -> None:
    errors = []
    for modes in (2, 4, 8):
        case = scene(modes=modes)
        wanted = direct(case, 60j)
        errors.append(np.abs(transfer(solved(case, tmp_path / "a.h5")[1], 60j) - wanted).max() / np.abs(wanted).max())
    assert errors[1] < errors[0] / 4
    assert errors[2] < errors[1] / 4


def test_free_bodies_have_rigid_modes_and_the_static_rest_of_the_others(tmp_path: Path) -> None:
    case = scene("boundary_conditions", modes=9)
    del case["springs"]
    summary, system = solved(case, tmp_path / "a.h5")
    assert sum(p["omega"] == 0 for p in summary["state_space"]["poles"]) >= 3
    for w in (10.0, 30.0, 100.0):
        wanted = direct(case, 1j * w)
        assert (np.abs(transfer(system, 1j * w) - wanted).max(axis=1) < 1e-3 * np.abs(wanted).max(axis=1)).all()


@pytest.mark.parametrize("modes", [1, 6])
def test_static_gain_is_that_of_linear_statics(tmp_path: Path, modes: int) -> None:
    names = ("push", "turn", "base")
    _, (A, B, C, D) = solved(scene(inputs=names, modes=modes), tmp_path / "a.h5")
    gain = D - C @ np.linalg.solve(A, B)
    for k, name in enumerate(names):
        case = scene("damping")
        case["solver"] = {"type": "linear_static"}
        case["loads"] = [load for load in case["loads"] if load["name"] == name]
        if name != "base":
            case["boundary_conditions"] = [{"type": "clamp", "at": "beam@0"}]
        probes = run_case(load_case_text(json.dumps(case))).summary["probes"]
        wanted = [probes[p][q] for p, q in (name.split(".") for name in OUTPUTS)]
        np.testing.assert_allclose(gain[:, k], wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_other_loads_are_reported_about_the_reference(tmp_path: Path) -> None:
    said = "other than inputs have no effect"
    for names, about, told in ((["push"], "reference", True), (["push"], "static", False),
                               (["push", "base"], "reference", True), (["push", "turn"], "reference", True),
                               (["push", "turn", "base"], "reference", False)):
        summary, _ = solved(scene(inputs=names, about=about), tmp_path / "a.h5")
        assert any(said in text for text in summary["warnings"]) == told


def test_gain_about_a_loaded_state_is_the_derivative_of_statics(tmp_path: Path) -> None:
    """The inputs do not act in the state; other loads do."""
    weight = {"name": "weight", "type": "force", "at": "beam@1", "value": [-1, -1]}
    held = scene(loads=[weight], about="static", inputs=["push", "turn"])
    held["boundary_conditions"] = [{"type": "clamp", "at": "beam@0"}]
    _, (A, B, C, D) = solved(held, tmp_path / "a.h5")

    def tip(factor: float) -> np.ndarray:
        case = scene("damping", loads=[weight])
        case["boundary_conditions"] = [{"type": "clamp", "at": "beam@0"}]
        case["solver"] = {"type": "static", "tolerance": 1e-13}
        case["loads"] = [{**case["loads"][0], "value": [0, -2 * factor]}, weight]
        probes = run_case(load_case_text(json.dumps(case))).summary["probes"]
        return np.array([probes[p][q] for p, q in (name.split(".") for name in OUTPUTS)])
    h = 1e-3
    np.testing.assert_allclose((D - C @ np.linalg.solve(A, B))[:, 0], (tip(h) - tip(-h)) / (2 * h), rtol=1e-6)


def moved(case: dict[str, Any], out: Path, scale: float, t_end: float) -> tuple[np.ndarray, np.ndarray]:
    """Times and tip.uy of the nonlinear motion after a step of the load, divided by its size."""
    case = copy.deepcopy(case)
    case["boundary_conditions"] = [{"type": "clamp", "at": "beam@0"}]
    case["loads"] = [{**case["loads"][0], "value": [0, -2 * scale]}]
    case["solver"] = {"type": "dynamic", "t_end": t_end, "tolerance": 1e-7, "estimate": False}
    case["output"]["interval"] = t_end / 200
    assert run_case(load_case_text(json.dumps(case)), str(out)).failure is None
    with open_results(out) as r:
        return np.array(r.probe_t), np.array(r.probes["tip"]["uy"]) / scale


def test_a_step_is_that_of_the_nonlinear_motion_at_small_amplitude(tmp_path: Path) -> None:
    """By scipy.signal.lsim, from the exported archive."""
    import scipy.signal  # takes a second, in every process that collects this file

    case = scene(inputs=["push"], modes=10)
    solved(case, tmp_path / "a.h5")
    export(tmp_path / "a.h5", tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        system = scipy.signal.StateSpace(*(file[name] for name in "ABCD"))
    t, wanted = moved(case, tmp_path / "b.h5", 1e-3, 0.4)
    keep = np.searchsorted(t, np.linspace(0, t[-1], 201)[1:] - 1e-9)
    grid = np.linspace(0, t[-1], 4001)
    found = scipy.signal.lsim(system, np.ones(len(grid)), grid)[1][:, 0]
    size = np.abs(wanted).max()
    assert np.abs(np.interp(t[keep], grid, found) - wanted[keep]).max() < 2e-3 * size


def test_exports_are_read_by_numpy_and_matlab_and_are_replaced(tmp_path: Path) -> None:
    _, system = solved(scene(), tmp_path / "a.h5")
    for suffix in (".npz", ".mat"):
        for _ in range(2):
            export(tmp_path / "a.h5", tmp_path / f"a{suffix}")
    with np.load(tmp_path / "a.npz") as file:
        of_numpy = {name: file[name] for name in file.files}
    of_matlab = scipy.io.loadmat(tmp_path / "a.mat", simplify_cells=True)
    for found in (of_numpy, of_matlab):
        for name, wanted in zip("ABCD", system, strict=True):
            np.testing.assert_array_equal(found[name], wanted)
        assert list(found["inputs"]) == ["push", "turn"]
        assert list(found["outputs"]) == OUTPUTS
        assert list(found["states"])[5:7] == ["q6", "q1'"]


def test_wrong_inputs_and_outputs_are_reported() -> None:
    for solver, said in (
            ({"inputs": ["pus"]}, "there is no load or prescribed motion named 'pus'"),
            ({"outputs": ["tip.uz"]}, "'tip.uz' is not a quantity of a probe"),
            ({"outputs": ["top.uy"]}, "there is no probe 'top'"),
            ({"outputs": ["tip.uy", "tip.uy"]}, "tip.uy is named twice")):
        with pytest.raises(CaseError, match=said):
            load_case_text(json.dumps(scene(**solver)))


@pytest.mark.slow
def test_a_regulator_of_python_control_damps_the_beam(tmp_path: Path) -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    case = scene(inputs=["push"], modes=10)
    _, system = solved(case, tmp_path / "a.h5")
    plant = control.ss(*system)
    t, wanted = moved(case, tmp_path / "b.h5", 1e-3, 0.4)
    found = control.step_response(plant, np.linspace(0, t[-1], 4001))
    response = np.asarray(found.outputs).reshape(len(OUTPUTS), -1)[0]
    assert np.abs(np.interp(t, found.time, response) - wanted).max() < 2e-3 * np.abs(wanted).max()
    np.testing.assert_allclose(np.sort_complex(control.poles(plant)), np.sort_complex(np.linalg.eigvals(system[0])))
    _, _, closed = control.lqr(plant, system[2].T @ system[2], np.eye(1) * 1e-4)
    damping = [-s.real / abs(s) for s in (np.linalg.eigvals(system[0]), closed)]
    assert damping[1][np.argmin(np.abs(closed))] > 3 * damping[0][np.argmin(np.abs(np.linalg.eigvals(system[0])))]
