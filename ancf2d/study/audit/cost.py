"""Cost of an element: time and floating-point operations of its forces and tangent."""

from __future__ import annotations

import time

import numpy as np

from .fields import beam
from .subject import NOTE, Finding, Subject, subject

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
