"""Functions that load, solve, refine, differentiate, optimise or fit a case, or create its discrete model."""

from __future__ import annotations

import json
import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias

from ..case import LoadedCase, load_case_text, with_overrides
from ..case.axes import Axis
from ..case.emit import number_text, yaml_text
from ..errors import MAPPING, TEXT, CaseError
from ..processors import one_blas_thread
from ..results.target import RESULTS, check_output
from ..study.accuracy.control import is_pursued, solve_to_accuracy
from ..study.convergence import Steps
from ..study.convergence import convergence as refine
from ..study.digests import inputs_of
from ..study.goal import Target
from ..study.optimise import METHODS, problem_of
from ..study.optimise import optimise as improve
from ..study.optimum import Optimum
from ..study.pool import Workers
from ..study.run import Outcome, prepare, run_case, vocabulary
from ..study.run import load as load_file
from ..study.sensitivity import Sensitivity
from ..study.sensitivity import sensitivity as differentiate
from ..study.variants import Variant, parse_variants
from .solution import PATHS, Convergence, Solution, Temporary, raise_type_error, texts_of

if TYPE_CHECKING:
    from ..solvers.discrete_model import DiscreteModel
    from ..study.fit import Fit

CaseLike: TypeAlias = "str | os.PathLike[str] | Mapping[str, Any] | LoadedCase"
Overrides: TypeAlias = "Mapping[str, Any] | Sequence[str] | None"
# YAML 1.1 reads a number with an exponent as text, unless it has a point and the exponent has a sign
_NUMBER_OF_1_2 = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+")


def options_of(overrides: Overrides) -> tuple[str, ...]:
    """Return overrides as command-line texts. Raises TypeError if they are neither a mapping nor texts."""
    if overrides is None:
        return ()
    if isinstance(overrides, Mapping):
        return tuple(Axis(path, (value,), "").override(value) for path, value in _plain(overrides).items())
    return texts_of(overrides, "overrides", "a mapping {path: value} or a list of 'path=value' strings", single=False)


def ranges_of(vary: Mapping[str, tuple[float, float]]) -> list[str]:
    """Return bounds by path as command-line texts. Raises TypeError if they are not pairs of numbers."""
    expected = "bounds by path, such as {'bodies.beam.material.E': (1e9, 1e11)}"
    if not (isinstance(vary, Mapping) and vary):
        raise_type_error("vary", expected, vary)
    options = []
    for path, pair in vary.items():
        try:
            low, high = map(float, pair)
        except (TypeError, ValueError):
            raise_type_error("vary", expected, {path: pair})
        options.append(f"{path}={number_text(low)}:{number_text(high)}")
    return options


def numbers_of(given: Any, what: str, expected: str, right: Callable[[float], bool]) -> list[float]:
    """Return a list of numbers, empty for None. Raises TypeError if they are not, CaseError if one is not ``right``."""
    if given is None:
        return []
    if not isinstance(given, Iterable):
        raise_type_error(what, expected, given)
    found = list(given)
    if not all(isinstance(x, Real) for x in found):
        raise_type_error(what, expected, given)
    for x in map(float, found):
        if not (math.isfinite(x) and right(x)):
            raise CaseError(f"{what}: expected {expected}, got {x:g}")
    return [float(x) for x in found]


def as_text(case: Mapping[str, Any]) -> str:
    """Return a case given as a mapping, possibly from ``yaml.safe_load``, as text."""
    # through JSON for arrays, numbers of NumPy and keys that are numbers, but as YAML, which has infinity and NaN
    return yaml_text(_plain(case))


def _plain(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping as plain Python data, with the misreadings of YAML 1.1 undone."""
    found: dict[str, Any] = json.loads(json.dumps(_as_yaml_1_2(value), default=plain_value))
    return found


def _as_yaml_1_2(value: Any) -> Any:
    """Return a value with the misreadings of YAML 1.1 undone: the key ``on`` as true, numbers such as 1e6 as text."""
    if isinstance(value, Mapping):
        return {"on" if key is True else key: _as_yaml_1_2(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_as_yaml_1_2(one) for one in value]
    return float(value) if isinstance(value, str) and _NUMBER_OF_1_2.fullmatch(value) else value


def plain_value(value: Any) -> Any:
    """Return a value that JSON can write, for arrays and numbers of NumPy, paths and other mappings."""
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a case holds numbers, strings, lists and mappings, not {type(value).__name__}")


def load(case: CaseLike, overrides: Overrides = ()) -> LoadedCase:
    """Return a checked case from a file, a multi-line YAML string, a mapping, or a loaded case, with overrides applied.

    ``overrides`` are values by their path, ``{"bodies.beam.element.count": 32}``, or the command line's
    ``["bodies.beam.element.count=32"]``. File names in a string or mapping are relative to the working directory.
    Raises CaseError, which lists all problems.
    """
    options = options_of(overrides)
    if isinstance(case, LoadedCase):
        return with_overrides(case, options, vocabulary())
    if isinstance(case, Mapping):
        return load_case_text(as_text(case), MAPPING, options, vocabulary())
    if isinstance(case, str) and "\n" in case:
        return load_case_text(case, TEXT, options, vocabulary())
    if not isinstance(case, str | os.PathLike):
        raise_type_error("case", "a file, a text, a mapping or a loaded case", case)
    return load_file(case, options)


@one_blas_thread()
def solve(case: CaseLike, overrides: Overrides = (), *, accuracy: float | None = None,
          output: str | os.PathLike[str] | None = None, force: bool = False, states: bool = True,
          partial: bool = False) -> Solution:
    """Solve a case and return its solution.

    ``accuracy`` is the relative error wanted for the case's goal: mesh and steps are chosen to reach it, and
    ``Solution.accuracy`` says whether they did. ``output`` names the result file to write, and ``force`` lets it
    replace one that ancf2d did not make. Without ``states`` and ``output`` only the summary is kept, which makes loops
    over many cases faster. With ``partial``, a computation that fails returns the states that it reached.

    Raises CaseError, which lists all problems of the case, ComputationError if it cannot be solved, and ResultsError
    if the file cannot be written.
    """
    loaded = load(case, (*options_of(overrides), *options_of({} if accuracy is None else {"accuracy": accuracy})))
    if not isinstance(output, str | os.PathLike | None):
        raise_type_error("output", "the name of a file", output)
    place = None if output is None else os.fspath(output)
    check_output(place, force, *inputs_of(loaded), kind=RESULTS)
    temporary = Temporary() if place is None and states else None
    target = str(temporary.file) if temporary is not None else place
    try:
        outcome = _outcome(loaded, target, force)
    except BaseException:
        if temporary is not None:
            temporary.remove()
        raise
    if outcome.failure is not None and not partial:
        if temporary is not None:
            temporary.remove()
        raise outcome.failure
    return Solution(loaded, outcome, temporary)


@one_blas_thread()
def convergence(case: CaseLike, overrides: Overrides = (), *, elements: Sequence[int] | None = None,
                types: str | Sequence[str] = (), dt: Sequence[float] = (), tolerance: Sequence[float] = (),
                reference: float | None = None, jobs: int = 1) -> Convergence:
    """Solve a case on a sequence of meshes, or with a sequence of time steps, and judge how its goal converges.

    ``elements`` are numbers of elements of the whole model (default: five, doubling from the case's own); ``types``
    element types to compare, as ``["vallejo", "reissner3", "vallejo:structural"]``; ``dt`` or ``tolerance`` refine
    the steps of a motion instead; ``reference`` is the exact value, if it is known. ``jobs`` meshes are solved at
    the same time. The study has ``rows`` (element, elements, value, error, order, ...) and ``series``, one of each
    type with its limit and error bar.

    Raises CaseError if the case has no goal, if no type can solve it, or if ``dt`` and ``tolerance`` are both given.
    """
    several = "positive numbers, such as [4e-3, 2e-3, 1e-3]"
    steps = [Steps(name, tuple(numbers_of(given, name, several, lambda x: x > 0.0)))
             for name, given in (("dt", dt), ("tolerance", tolerance))]
    steps = [one for one in steps if one.values]
    if len(steps) > 1:
        raise CaseError("dt and tolerance are both given; give only one")
    meshes = numbers_of(elements, "elements", "whole numbers, such as [2, 4, 8]", lambda x: x >= 1.0 and x == int(x))
    names, variants = texts_of(types, "types", "element types, such as ['vallejo', 'reissner3']"), [Variant()]
    if names:
        try:
            variants = parse_variants(",".join(names))
        except ValueError as error:
            raise CaseError(str(error)) from None
    found = refine(load(case, overrides), variants, [int(n) for n in meshes] or None, reference, Workers(jobs),
                   steps=steps[0] if steps else None)
    return Convergence(**vars(found))


@one_blas_thread()
def sensitivity(case: CaseLike, to: str | Sequence[str] = (), overrides: Overrides = ()) -> Sensitivity:
    """Return the derivatives of a case's goal with respect to numbers of the case, the most influential first.

    ``to`` are paths such as ``["bodies.beam.section.height", "loads.0.value.1"]``; by default all numbers that can
    vary. ``rows`` have path, value, derivative, elasticity, the error estimate of the derivative, and the method:
    equilibria, small motions, buckling factors and most motions are differentiated exactly, all else by
    differences of runs.

    Raises CaseError if the case has no goal or a path leads to no number that can vary, ComputationError if the case
    cannot be solved.
    """
    paths = texts_of(to, "to", PATHS)
    return differentiate(load(case, overrides), paths)


@one_blas_thread()
def optimise(case: CaseLike, vary: Mapping[str, tuple[float, float]], minimise: str,
             subject_to: str | Sequence[str] = (), overrides: Overrides = (), *, method: str = "slsqp",
             iterations: int = 100) -> Optimum:
    """Find the best values of some numbers of a case, with SciPy's optimisers and exact derivatives.

    ``vary`` has the bounds of each number by its path; ``minimise`` and ``subject_to`` are expressions as in
    ``ancf2d optimise``, such as ``"mass"`` and ``["max(stress) <= 200e6"]``. ``method`` is slsqp or
    trust-constr. The optimum has ``rows`` (path, value, ...), ``minimum``, ``constraints``, and ``found``, which is
    False if the optimiser did not converge or the constraints cannot be met.

    Raises CaseError for a wrong case, path or expression, ComputationError if a case on the way cannot be solved.
    """
    if method not in METHODS:
        raise CaseError(f"there is no method '{method}'; there are {', '.join(METHODS)}")
    if not isinstance(minimise, str):
        raise_type_error("minimise", "an expression, such as 'mass'", minimise)
    wanted = texts_of(subject_to, "subject_to", "constraints, such as ['max(stress) <= 200e6']")
    return improve(problem_of(load(case, overrides), ranges_of(vary), minimise, wanted), method, iterations)


@one_blas_thread()
def fit(case: CaseLike, data: str | os.PathLike[str] | Mapping[str, Any], vary: Mapping[str, tuple[float, float]],
        overrides: Overrides = (), *, sigma: Mapping[str, float] | None = None, starts: int = 1) -> Fit:
    """Return the numbers with which a case agrees best with measured data, by least squares.

    ``data`` is a CSV file or columns by name: first ``t``, ``factor`` or ``hz``, then ``"PROBE.QUANTITY"``, with NaN
    where nothing was measured. ``vary`` gives bounds by path, ``{"bodies.beam.material.E": (1e9, 1e11)}``. ``sigma`` is
    the noise of columns by name; without it they are weighted by their ranges. ``starts`` searches begin between the
    bounds, the first at the case's own numbers. The fit has ``rows`` (path, value, standard_error, ...), ``residual``,
    ``data``, ``model`` and ``overrides()``, with which ``solve`` runs the fitted case.

    Raises CaseError, which lists all problems, and ComputationError if no start can be solved.
    """
    from ..study.fit import fit as fit_to
    from ..study.fit_data import data_of, read_data

    if not isinstance(data, str | os.PathLike | Mapping):
        raise_type_error("data", "a CSV file or columns by name, such as {'t': [...], 'tip.uy': [...]}", data)
    if starts < 1:
        raise CaseError(f"starts is {starts}; expected at least 1")
    columns = data_of(data) if isinstance(data, Mapping) else read_data(os.fspath(data))
    return fit_to(load(case, overrides), columns, ranges_of(vary), sigma, starts)


def system(case: CaseLike, overrides: Overrides = ()) -> DiscreteModel:
    """Return the discrete model of a case for your own solvers and integrators: residual, tangents, mass, probes.

    Nothing is solved. ``case`` and ``overrides`` are those of ``solve``. In a dynamic case t is the time, in all others
    the load factor. Raises CaseError with all problems of the case, or if the mesh of the case is to be chosen for an
    accuracy.
    """
    loaded = load(case, overrides)
    if is_pursued(loaded):
        raise CaseError("accuracy, or element type auto, leaves the mesh to be chosen while the case is solved; give "
                        "every body an element type and count, and no accuracy")
    model = prepare(loaded)
    from ..solvers.discrete_model import DiscreteModel

    return DiscreteModel(model)


def _outcome(loaded: LoadedCase, target: str | None, force: bool) -> Outcome:
    if not is_pursued(loaded):
        return run_case(loaded, target, force=force)
    return solve_to_accuracy(loaded, None if target is None else Target(target, force)).outcome
