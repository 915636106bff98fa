"""Plugins of one file each, whose springs, loads and formulations work wherever built-in ones do."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import helpers as h
import numpy as np
import pytest
from click.testing import CliRunner
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import ancf2d
from ancf2d import extend
from ancf2d.cli.app import app
from ancf2d.errors import CaseError, PluginError
from ancf2d.extend import plugins

HERE = Path(__file__).parent / "plugins"
# a stiff rod of 2 kg that slides along x
MASS, EA = 2.0, 1e11
K, K3, FORCE = 300.0, 5e4, 40.0
POLE, STRENGTH, REACH = 1.6, 30.0, 0.3


def add(*names: str) -> None:
    for name in names:
        plugins.add_plugin(str(HERE / f"{name}.py"))


def rod(solver, element="reissner2", **scene):
    body = {"geometry": h.line(1.0), "element": h.element(element, 2),
            "section": {"EA": EA, "kGA": 1e8, "EI": 1e6, "rhoA": MASS, "rhoI": 1e-3}}
    rollers = [{"type": "roller", "at": f"rod@{s}", "fixed": "y"} for s in (0, 1)]
    probes = {"output": {"probes": {"end": "rod@1"}}}
    return ancf2d.solve(h.load({"rod": body}, solver, bc=rollers, **probes, **scene))


def spring(**more):
    return {"type": "hardening", "between": [[-1, 0], "rod@0"], "stiffness": K, "cubic": K3, **more}


def magnet(**more):
    return {"type": "magnet", "at": "rod@1", "pole": [POLE, 0], "strength": STRENGTH, "reach": REACH, **more}


def force_of_spring(u):
    return K * u + K3 * u**3


def force_of_magnet(u):
    r = POLE - 1.0 - u
    return STRENGTH * r / (r * r + REACH**2) ** 1.5


def test_a_plugin_is_one_short_file() -> None:
    for path in HERE.glob("*.py"):
        assert len(path.read_text().splitlines()) <= 40, path


def test_the_page_on_plugins_shows_these_files() -> None:
    page = (Path(__file__).parents[2] / "docs" / "extending.md").read_text(encoding="utf-8")
    for path in HERE.glob("*.py"):
        assert f"```python\n{path.read_text(encoding='utf-8')}```" in page, path


@pytest.mark.usefixtures("registries")
def test_a_custom_spring_in_statics_modes_and_motion() -> None:
    add("hardening")
    load = [{"type": "force", "at": "rod@1", "value": [FORCE, 0]}]
    u = brentq(lambda x: force_of_spring(x) - FORCE, 0.0, 1.0, xtol=1e-15)
    found = rod({"type": "static", "steps": 2}, springs=[spring()], loads=load)
    assert found.probes["end"]["ux"] == pytest.approx(u + FORCE / EA, rel=1e-9)
    assert found.summary["energy"]["strain"] == pytest.approx(K * u**2 / 2 + K3 * u**4 / 4, rel=1e-6)
    linear = rod("linear_static", springs=[spring()], loads=load)
    assert linear.probes["end"]["ux"] == pytest.approx(FORCE / K, rel=1e-6)
    modes = rod({"type": "eigen", "modes": 1, "about": "static"}, springs=[spring()], loads=load)
    assert modes.summary["frequencies"][0]["omega"] == pytest.approx(np.sqrt((K + 3 * K3 * u * u) / MASS), rel=1e-6)
    exact = solve_ivp(lambda t, y: [y[1], (FORCE - force_of_spring(y[0])) / MASS], (0, 0.5), [0, 0], "DOP853",
                      rtol=1e-11, atol=1e-13).y[0, -1]
    moved = rod({"type": "dynamic", "t_end": 0.5, "tolerance": 1e-7}, springs=[spring()], loads=load)
    assert moved.probes["end"]["ux"] == pytest.approx(exact, abs=1e-6 * u)
    assert moved.summary["energy_drift"] < 1e-6


@pytest.mark.usefixtures("registries")
def test_a_custom_spring_conserves_energy() -> None:
    add("hardening")
    moved = rod({"type": "dynamic", "t_end": 0.5, "dt": 0.01, "method": "energy_momentum", "estimate": False},
                element="cable", springs=[spring()], initial={"velocity": [1.0, 0.0]})
    assert moved.summary["energy_drift"] < 1e-10


@pytest.mark.usefixtures("registries")
def test_a_custom_load_in_statics_modes_and_motion() -> None:
    add("magnet")
    linear_spring = {"type": "translational", "between": [[-1, 0], "rod@0"], "stiffness": 800.0}
    u = brentq(lambda x: 800 * x - force_of_magnet(x), 0.0, 0.2, xtol=1e-15)
    slope = (force_of_magnet(u + 1e-6) - force_of_magnet(u - 1e-6)) / 2e-6
    found = rod({"type": "static", "steps": 3}, springs=[linear_spring], loads=[magnet()])
    assert found.probes["end"]["ux"] == pytest.approx(u, rel=1e-6)
    modes = rod({"type": "eigen", "modes": 1, "about": "static"}, springs=[linear_spring], loads=[magnet()])
    assert modes.summary["frequencies"][0]["omega"] == pytest.approx(np.sqrt((800 - slope) / MASS), rel=1e-6)
    exact = solve_ivp(lambda t, y: [y[1], (force_of_magnet(y[0]) - 800 * y[0]) / MASS], (0, 0.5), [0, 0], "DOP853",
                      rtol=1e-11, atol=1e-13).y[0, -1]
    moved = rod({"type": "dynamic", "t_end": 0.5, "tolerance": 1e-7}, springs=[linear_spring], loads=[magnet()])
    assert moved.probes["end"]["ux"] == pytest.approx(exact, abs=1e-6)


def add_point_load(kind: str, law: Callable[..., tuple[float, ...]], potential: bool) -> None:
    """Register loads on a point with one constant, ``stiffness``."""
    @extend.load(law, potential=potential)
    @extend.record
    class PointLoad:
        """A force on a point."""

        tag = kind
        at: object = extend.key(extend.POINT, "Point")
        stiffness: float = extend.key(extend.Number("N/m"), "k")
        amplitude: object = extend.key(extend.AMPLITUDE, extend.AMPLITUDE_DOC, default=None)
        name: str | None = extend.key(extend.NAME, "Name", default=None)

        def constants(self):
            return [self.stiffness]


@pytest.mark.usefixtures("registries")
def test_a_custom_load_may_have_a_key_of_tendons() -> None:
    add_point_load("well", lambda x, y, par: (-par[0] * x, 0.0, -par[0], 0.0, 0.0, 0.0), potential=True)
    loads = [{"type": "well", "at": "rod@0", "stiffness": 100.0, "amplitude": {"type": "constant"}},
             {"type": "force", "at": "rod@0", "value": [3.0, 0]}]
    spring = [{"type": "translational", "between": [[-1, 0], "rod@0"], "stiffness": 200.0}]
    # linear statics takes loads as they are in the reference
    for solver, stiffness in (("linear_static", 200.0), ("static", 300.0)):
        found = rod({"type": solver}, springs=spring, loads=loads)
        assert found.probes["end"]["ux"] == pytest.approx(3.0 / stiffness, rel=1e-6)


@pytest.mark.usefixtures("registries")
def test_a_motion_starts_from_the_equilibrium_under_a_custom_load() -> None:
    """At t = 0 the magnet pulls with half its strength: the motion starts in equilibrium with it."""
    add("magnet")
    linear_spring = {"type": "translational", "between": [[-1, 0], "rod@0"], "stiffness": 800.0}
    u = brentq(lambda x: 800 * x - 0.5 * force_of_magnet(x), 0.0, 0.2, xtol=1e-15)
    half = {"type": "constant", "scale": 0.5}
    moved = rod({"type": "dynamic", "t_end": 0.01, "tolerance": 1e-7}, springs=[linear_spring],
                loads=[magnet(amplitude=half)], initial={"from": "static"})
    assert moved.probes["end"]["ux"] == pytest.approx(u, rel=1e-6)


@pytest.mark.usefixtures("registries")
def test_a_custom_formulation_in_statics_modes_and_motion() -> None:
    """With the strain of small displacements, statics are linear statics of the continuum at any load."""
    add("small_strain")

    def beam(solver, formulation):
        body = {"geometry": h.line(1.0), "element": h.element("2d2n", 3, formulation, quadrature=[3, 3])}
        body |= {"section": {"height": 0.1, "width": 0.1}, "material": {"E": 1e6, "nu": 0.3, "rho": 1e3}}
        return ancf2d.solve(h.load({"b": body}, solver, bc=[{"type": "clamp", "at": "b@0"}],
                        loads=[{"type": "force", "at": "b@1", "value": [10, -30]}],
                        output={"probes": {"tip": "b@1"}}), states=False)

    tip = beam("linear_static", "continuum").probes["tip"]["uy"]
    assert abs(tip) > 0.5
    assert beam("static", "small_strain").probes["tip"]["uy"] == pytest.approx(tip, rel=1e-9)
    omegas = [[f["omega"] for f in beam({"type": "eigen", "modes": 3}, name).summary["frequencies"]]
              for name in ("small_strain", "continuum")]
    np.testing.assert_allclose(*omegas, rtol=1e-8)
    moved = beam({"type": "dynamic", "t_end": 0.05, "tolerance": 1e-6}, "small_strain")
    assert moved.summary["energy_drift"] < 1e-6


@pytest.mark.usefixtures("registries")
def test_a_damper_may_be_any_function_of_the_rate() -> None:
    """Its force grows with the square of the rate, so that its damping at rest is zero."""
    def drag(u, rate, par):
        return 0.0, par[0] * rate * abs(rate), 0.0, 2.0 * par[0] * abs(rate)

    @extend.spring(drag, damped=True)
    @extend.record
    class Drag:
        """A damper whose force grows with the square of the rate."""

        tag = "drag"
        between: tuple = extend.key(extend.ENDS, "The two ends")
        factor: float = extend.key(extend.Number("N s^2/m^2"), "Factor")
        name: str | None = extend.key(extend.NAME, "Name", default=None)

        def constants(self):
            return [self.factor]

    scene = {"springs": [{"type": "drag", "between": [[-1, 0], "rod@0"], "factor": 5.0}],
             "initial": {"velocity": [3.0, 0.0]}}
    moved = rod({"type": "dynamic", "t_end": 0.5, "tolerance": 1e-7}, **scene)
    # m v' = -c v^2
    assert moved.probes["end"]["vx"] == pytest.approx(3.0 / (1 + 5.0 * 3.0 * 0.5 / MASS), rel=1e-6)
    system = ancf2d.system(moved.case)
    z, v = system.initial()
    force = system.residual(z, v, 0.0)
    assert force.sum() == pytest.approx(5.0 * 3.0**2, rel=1e-9)
    assert not system.damping(z).toarray().any()
    modes = rod({"type": "eigen", "modes": 1}, springs=[*scene["springs"], spring_of(K)])
    assert any("springs.0" in w and "small motions" in w for w in modes.warnings)
    modes = rod({"type": "eigen", "modes": 1, "damped": False}, springs=[*scene["springs"], spring_of(K)])
    assert any("undamped (damped: false), so springs.0 has no effect" in w for w in modes.warnings)


def spring_of(stiffness):
    return {"type": "translational", "between": [[-1, 0], "rod@0"], "stiffness": stiffness}


CASE = """
bodies:
  rod:
    geometry: {type: line, start: [0, 0], end: [1, 0]}
    section: {EA: 1e6, kGA: 1e6, EI: 1e3}
    element: {type: reissner2, count: 1}
boundary_conditions: [{type: roller, at: rod@0, fixed: y}, {type: roller, at: rod@1, fixed: y}]
springs: [{type: hardening, between: [[-1, 0], rod@0], stiffness: 300, %s}]
loads: [{type: force, at: rod@1, value: [40, 0]}]
solver: {type: static}
"""


@pytest.mark.usefixtures("registries")
def test_the_command_line_loads_a_plugin(tmp_path) -> None:
    case, runner, plugin = tmp_path / "case.yaml", CliRunner(), str(HERE / "hardening.py")
    case.write_text(CASE % "cubic: 5e4")
    without = runner.invoke(app, ["validate", str(case)])
    assert without.exit_code == 2
    assert "springs.0.type must be translational" in without.stderr
    assert "translational" in without.stderr
    done = runner.invoke(app, ["run", str(case), "--plugin", plugin, "--json", "-o", str(tmp_path / "out.h5")])
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "converged"
    schema = runner.invoke(app, ["schema", "--plugin", plugin])
    assert "Factor of the cube of the elongation" in schema.stdout
    case.write_text(CASE % "cubic: -1")
    wrong = runner.invoke(app, ["validate", str(case), "--plugin", plugin])
    assert wrong.exit_code == 2
    assert "springs.0.cubic" in wrong.stderr
    case.write_text(CASE % "cubik: 1")
    assert "did you mean 'cubic'" in runner.invoke(app, ["validate", str(case), "--plugin", plugin]).stderr


@pytest.mark.usefixtures("registries")
def test_a_plugin_that_fails_is_named_with_its_line(tmp_path) -> None:
    case = tmp_path / "case.yaml"
    case.write_text(CASE % "cubic: 5e4")
    spring_without_keys = "from ancf2d.extend import *\n@spring(len)\n@record\nclass A:\n    tag = 'a'\n"
    for text, words in (("x = 1\n1/0\n", ":2: the plugin cannot be loaded: ZeroDivisionError"),
                        ("raise SystemExit(3)", "SystemExit: 3"),
                        ("x = (\n", "SyntaxError"), (spring_without_keys, "has no key between")):
        path = tmp_path / f"wrong{len(text)}.py"
        path.write_text(text)
        done = CliRunner().invoke(app, ["validate", str(case), "--plugin", str(path)])
        assert done.exit_code == 2
        assert words in done.stderr
        assert "Traceback" not in done.stderr
    done = CliRunner().invoke(app, ["validate", str(case), "--plugin", "nowhere.py"])
    assert done.exit_code == 2
    assert "does not exist" in done.stderr


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize(("name", "old", "new", "words"), [
    ("hardening", ", k + 3 * k3 * u**2, 0.0", "", "the force of Hardening returns 2 values; expected 4: energy, N,"),
    ("hardening", "(u, rate, par)", "(u, par)", "the force of Hardening: force() takes 2 positional arguments"),
    ("hardening", "[self.stiffness, self.cubic]", "self.stiffness", "returns 300.0; expected a list of numbers"),
    ("hardening", "self.cubic]", "self.cubik]", ":25: the plugin fails: AttributeError: 'Hardening' object has no"),
    ("hardening", "k, k3 = par[0], par[1]", "k, k3 = par[2], 0", ":8: the plugin fails: IndexError"),
    ("small_strain", "eps, J, lanes)", "eps, J)", "strain(ref, u, eps, J) takes other arguments; expected strain("),
    ("hardening", "k + 3 * k3 * u**2", "2 * k", "returns dN/du = 600 at (-2.9, 0), but N changes there by 1.2618e+06"),
    ("hardening", "k3 * u**4 / 4", "k3 * u**4 / 2", "returns N = -1.22032e+06 at (-2.9, 0), but energy changes there"),
    ("small_strain", "StrainLaw(4, 3", "StrainLaw(4, 2", "strain uses places that its arrays do not have (index 2 is")],
    ids=["returns", "arguments", "constants", "attribute", "index", "formulation", "tangent", "energy", "places"])
def test_a_plugin_that_contradicts_its_declaration_is_named(tmp_path, name, old, new, words) -> None:
    case, path, text = tmp_path / "case.yaml", tmp_path / "wrong.py", (HERE / f"{name}.py").read_text()
    case.write_text(CASE % "cubic: 5e4")
    path.write_text(text.replace(old, new))
    done = CliRunner().invoke(app, ["run", str(case), "--plugin", str(path), "-o", str(tmp_path / "out.h5")])
    assert done.exit_code == 2
    assert words in done.stderr
    assert not (tmp_path / "out.h5").exists()


@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("kind", ["wrong", "kinked"])
def test_derivatives_of_a_custom_load_are_checked_except_at_kinks(kind) -> None:
    """A wall that pushes where x > 0.41, a point at which derivatives are checked, and turns over it."""
    def wall(x, y, par):
        over = max(x - 0.41, 0.0)
        k = par[0] if over > 0.0 else 0.0
        return -par[0] * over * y, 0.0, -k * y, -par[0] * over * (2.0 if kind == "wrong" else 1.0), 0.0, 0.0

    add_point_load("wall", wall, potential=False)
    scene = {"springs": [spring_of(K)], "loads": [{"type": "wall", "at": "rod@0", "stiffness": 1.0}]}
    if kind == "kinked":
        assert rod({"type": "static"}, **scene).status == "converged"
        return
    with pytest.raises(PluginError, match=r"the force of PointLoad returns dfx/dy = -.*, but fx changes there by"):
        rod({"type": "static"}, **scene)


@pytest.mark.slow
@pytest.mark.usefixtures("registries")
@pytest.mark.parametrize("wrong", ["{'k': par[0], 1: 0}['k']", "float(len(dir(par)))"], ids=["lowering", "typing"])
def test_a_plugin_that_cannot_be_compiled_is_named_with_its_line(tmp_path, wrong) -> None:
    case, path = tmp_path / "case.yaml", tmp_path / "wrong.py"
    case.write_text(CASE % "cubic: 5e4")
    path.write_text((HERE / "hardening.py").read_text().replace("k, k3 = par[0]", f"k, k3 = {wrong}"))
    done = CliRunner().invoke(app, ["run", str(case), "--plugin", str(path), "-o", str(tmp_path / "out.h5")])
    assert done.exit_code == 2
    assert f"{path}:8: the plugin cannot be compiled: " in done.stderr


@pytest.mark.usefixtures("registries")
def test_built_in_names_cannot_be_replaced() -> None:
    def again():
        @extend.spring(lambda u, rate, par: (0.0, 0.0, 0.0, 0.0))
        @extend.record
        class Translational:
            """Another one."""

            tag = "translational"
            between: tuple = extend.key(extend.ENDS, "The two ends")
            name: str | None = extend.key(extend.NAME, "Name", default=None)

            def constants(self):
                return []

    with pytest.raises(PluginError, match="springs already have a type 'translational'"):
        again()
    with pytest.raises(PluginError, match="already a formulation 'continuum'"):
        extend.formulation(replace(extend.FORMULATIONS["continuum"], doc="another one"))
    with pytest.raises(CaseError, match="hardening"):
        rod("static", springs=[spring()])


@pytest.mark.usefixtures("registries")
def test_reserved_keys_of_loads_are_refused() -> None:
    with pytest.raises(PluginError, match="OnLine: loads declare line to the model; rename the key"):
        @extend.load(lambda x, y, par: (0.0,) * 6, potential=True)
        @extend.record
        class OnLine:
            """A load with a key that says where loads along bodies act."""

            tag = "on_line"
            at: object = extend.key(extend.POINT, "Point")
            line: float = extend.key(extend.Number("m"), "x of a line")
            amplitude: object = extend.key(extend.AMPLITUDE, extend.AMPLITUDE_DOC, default=None)
            name: str | None = extend.key(extend.NAME, "Name", default=None)

            def constants(self):
                return [self.line]


@pytest.mark.usefixtures("registries")
def test_reuts_column() -> None:
    """Reut 1939: a force on a fixed line on a plate at the tip, the adjoint of Beck's column with its critical load."""
    add("fixed_line")
    column = {"geometry": {"type": "line", "start": [0, 0], "end": [0, 1]}, "element": h.element("cable", 16),
              "section": {"EA": 1e7, "kGA": 1e7, "EI": 1, "rhoA": 1, "rhoI": 1e-7}}
    plate = {"geometry": {"type": "line", "start": [-0.1, 1], "end": [0.1, 1]},
             "element": {"type": "rigid", "mass": 1e-9, "inertia": 1e-12}}
    ends = [{"type": "fixed_line", "at": f"plate@{s}", "value": -1, "axis": 0, "width": width}
            for s, width in ((0, 0.2), (1, -0.2))]
    found = ancf2d.solve(h.load({"column": column, "plate": plate}, {"type": "buckling", "modes": 1}, loads=ends,
                                bc=[{"type": "clamp", "at": "column@0"}],
                                joints=[{"type": "weld", "between": ["column@1", "plate@0.5"]}]),
                         states=False).summary["critical"][0]
    assert found["kind"] == "flutter"
    assert found["factor"] == pytest.approx(20.0509, rel=1e-4)
    # of both columns, where the frequencies meet
    assert found["omega"] == pytest.approx(11.0156, rel=2e-3)
