"""The list of checks, and the audit that runs them."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import Ancf2dError, ComputationError
from ..warmup import warm_up
from . import kinematics, laws, locking, meshes, patches
from .fields import beam
from .subject import FAIL, NOTE, Check, CheckResult, Finding, Subject, subject

# element to compare with, measured in the same process
YARDSTICK = "vallejo"
ELEMENTS, REPEATS = 500, 7


def seconds_per_element(s: Subject) -> float:
    """Return the time of forces and tangent per element, the best of several passes over many."""
    from ...kernels.elements import element_matrices

    model = s.free(float(ELEMENTS), ELEMENTS)
    (group,) = model.groups
    n = beam(model).dofs.shape[1]
    Q, K, d = np.zeros((ELEMENTS, n)), np.zeros((ELEMENTS, n, n)), np.zeros(model.n_q)
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        element_matrices(group, d, Q, K)
        times.append(time.perf_counter() - start)
    return min(times) / ELEMENTS


def operations(s: Subject) -> int:
    """Return the multiplications and additions of one element's forces and tangent, without zeros in B and D."""
    law = s.free(1.0, 1).groups[0].law
    fields, stations, n = law.B.shape[1:]
    strains = law.D.shape[1]
    entries = int(np.count_nonzero(law.B[0]))
    couplings = int(np.count_nonzero(law.D[0]))
    # u = B d, sigma = D eps, g = J^T sigma, H = J^T D J, Q_e += B^T g, H B, K += B^T (H B)
    return int(2 * stations * (fields * n + strains**2 + strains * fields + fields * n + fields**2 * n)
               + 2 * couplings * fields**2 + 2 * entries * n)


def cost(s: Subject) -> Finding:
    """Examine the time of forces and tangent of an element, compared with vallejo."""
    yard = subject(YARDSTICK)
    own, theirs = seconds_per_element(s), seconds_per_element(yard)
    return Finding(own / theirs, NOTE, f"{1e6 * own:.2f} us for forces and tangent, compared with {1e6 * theirs:.2f} "
                   f"us of {YARDSTICK}; about {operations(s)} operations, against {operations(yard)}")


# every check is listed here
CHECKS = (
    Check("solvability", "Do the nodal coordinates determine the basis? Condition number of the interpolation matrix",
          kinematics.solvability),
    Check("completeness", "Does the basis contain every linear field?", kinematics.completeness),
    Check("rigid_motion", "Do translations and finite rotations cause forces?", patches.rigid_motion),
    Check("objectivity", "Does a superposed finite rotation change the energy of a deformed state?",
          patches.objectivity),
    Check("isotropy", "Does the response depend on the direction of the beam in the plane?", patches.isotropy, 4),
    Check("reversal_symmetry", "Is the element the same with its ends swapped?", kinematics.reversal),
    Check("mirror_symmetry", "Is the element the same upside down?", kinematics.mirror),
    Check("patch_axial", "Is uniform tension exact on unequal elements?", patches.patch_axial),
    Check("patch_transverse", "Is uniform tension across exact on unequal elements?", patches.patch_transverse),
    Check("patch_shear", "Is uniform shear exact on unequal elements?", patches.patch_shear),
    Check("patch_bending", "Is pure bending exact on unequal elements?", patches.patch_bending, 4),
    Check("zero_energy_modes", "How many motions other than rigid ones have no strain energy?",
          patches.zero_energy_modes),
    Check("position_continuity", "Do neighbours share the whole of their common section?",
          kinematics.position_continuity),
    Check("slope_continuity", "Is r_x continuous between elements?", kinematics.slope_continuity),
    Check("spurious_branch", "Do modes of the mesh fall among those of the beam as the mesh is refined?",
          meshes.spurious_branch, 21),
    Check("damping", "Do modes decay as Rayleigh and Kelvin-Voigt damping say, and is rigid motion undamped?",
          meshes.damping),
    Check("shear_factor", "What is the effective shear factor in uniform shear?", locking.shear_factor),
    Check("shear_in_bending", "What is the effective shear factor in bending?", locking.shear_in_bending, 5),
    Check("shear_locking", "How much of a small deflection do slender beams lose?", locking.shear_locking, 3),
    Check("poisson_locking", "How much of the bending compliance is lost as nu grows?", locking.poisson_locking, 9),
    Check("poisson_locking_of_basis", "How much of it is lost in the full continuum form?",
          locking.poisson_locking_of_basis, 8),
    Check("thickness_locking", "How much of a large deflection do slender beams lose?", locking.thickness_locking, 10),
    Check("order_static", "With what order does a deflection converge, and to what?", meshes.order_static, 5),
    Check("order_eigen", "With what order does a frequency converge, and to what?", meshes.order_eigen, 17),
    Check("cost", "What do forces and tangent cost, compared with vallejo?", cost, 5),
)
# further checks, made on request, of the material laws that the element supports
LAW_CHECKS = (
    Check("law_tangent", "Is the tangent of each law the derivative of the forces, along a load path and back?",
          laws.law_tangent),
    Check("law_objectivity", "Do the forces of each law rotate with a body that rotates along its load path?",
          laws.law_objectivity),
    Check("law_dissipation", "Does any step of a load path create energy?", laws.law_dissipation),
    Check("law_cycles", "Do repeated cycles dissipate the same energy?", laws.law_cycles, 5),
)
# checks that are possible if the coordinates do not determine the basis
WITHOUT_SHAPES = ("solvability",)


@dataclass(frozen=True)
class Audit:
    """A finished audit of an element."""

    subject: Subject
    results: tuple[CheckResult, ...]

    @property
    def made(self) -> tuple[CheckResult, ...]:
        """The results of the checks that were possible."""
        return tuple(a for a in self.results if self.subject.flaw is None or a.check.name in WITHOUT_SHAPES)

    @property
    def counts(self) -> dict[str, int]:
        """The number of checks with each verdict."""
        return dict(Counter(a.finding.verdict for a in self.results))

    def as_json(self) -> dict[str, Any]:
        """Return the object that ``--json`` prints."""
        s, plan = self.subject, self.subject.plan
        out: dict[str, Any] = {"element": s.name, "basis": list(s.element.basis), "coordinates": s.element.n_dof}
        if plan is not None:
            out.update(formulation=plan.formulation.name, shear_factor=plan.section.k_s,
                       quadrature={"normal": list(plan.rule.normal), "shear": list(plan.rule.shear)})
        return {**out, "checks": [a.as_json() for a in self.results], "verdicts": self.counts}


def audit(subject: Subject, checks: tuple[Check, ...] = CHECKS, compiling: Callable[[str], None] = lambda text: None,
          done: Callable[[float, str], None] = lambda share, name: None) -> Audit:
    """Run all checks on an element; ``done`` is called with the share of work done and the name of the next check.

    ``compiling`` is called if kernels must be compiled first.
    """
    results = []
    if subject.flaw is None:
        with suppress(Ancf2dError):
            warm_up(subject.model(1.0, 2, "static", boundary_conditions=[subject.wall]), compiling)
    whole = sum(check.work for check in checks)
    for k, check in enumerate(checks):
        done(sum(c.work for c in checks[:k]) / whole, check.name)
        results.append(CheckResult(check, _examined(check, subject)))
    done(1.0, "")
    return Audit(subject, tuple(results))


def _examined(check: Check, subject: Subject) -> Finding:
    """Return the finding of a check; one that cannot be computed fails with the reason."""
    if subject.flaw is not None and check.name not in WITHOUT_SHAPES:
        return Finding(None, NOTE, "not examined: there are no shape functions")
    try:
        with np.errstate(all="ignore"):
            return check.examine(subject)
    except ComputationError as error:
        return Finding(None, FAIL, f"cannot be computed: {error.failure.reason}")
    except (Ancf2dError, ArithmeticError, np.linalg.LinAlgError) as error:
        return Finding(None, FAIL, f"cannot be computed: {str(error).splitlines()[0]}")
