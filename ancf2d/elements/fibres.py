"""Sections made of fibres along the axis, each with its own uniaxial law: plastic or nonlinear elastic.

A formulation can have fibres if its strains give the strain e = eps - y kappa of every fibre. Its section forces are
sums over Gauss points through the height of each layer, N = sum w s and M = -sum w y s. Kernels see them as forces of
the elastic section, D (eps - eps_i), with internal strains eps_i for the stress that fibres do not bear; shear stays
elastic.

The law of a plastic fibre has isotropic and linear kinematic hardening, independent of rate: with the plastic strain p
and its accumulated magnitude a, |E (e - p) - K p| <= s(a). The return map is exact in a step of one direction (Simo &
Hughes 1998, section 1.4), and so is its derivative, the consistent tangent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from .formulations.base import Formulation, Free, Rule, Sampler, StrainLaw, of_section
from .section import Section
from .shape import Array, gauss

# relative excess over the yield stress that counts as yielding: fibres at the end of an accepted step do not
BEYOND = 1e-10
# share of E: least tangent of a yielding fibre, so that the matrix stays regular if all fibres of a section yield.
# If two such sections meet at a node, the division of the hinge between them is not determined: with a smaller
# tangent, the remaining residual would rotate the node by more than fibres need to yield and unload
LEFT = 1e-6
# share of E: below this final slope a section of yielding fibres counts as a hinge
FLOWS = 0.01
# default number of Gauss points through the height of each layer
FIBRES = 16


@dataclass(frozen=True)
class Uniaxial:
    """The stress-strain law of a fibre: first E [Pa], then straight lines from ``at`` with ``stress`` and ``slope``.

    In an ``elastic`` law, ``at`` are strains, starting with 0; otherwise plastic strains, starting with 0, ``stress``
    is the yield stress there, and ``kinematic`` [Pa] shifts the yield surface per plastic strain.
    """

    E: float
    at: tuple[float, ...]
    stress: tuple[float, ...]
    slope: tuple[float, ...]
    kinematic: float = 0.0
    elastic: bool = False

    @property
    def flows(self) -> bool:
        """Whether the fibre yields with almost no final hardening, so that a section of such fibres can be a hinge."""
        return not self.elastic and self.slope[-1] + self.kinematic < FLOWS * self.E

    @property
    def numbers(self) -> list[float]:
        """All constants in one list, in the order that ``internal`` reads."""
        lines = zip(self.at, self.stress, self.slope, strict=True)
        return [float(self.elastic), self.E, self.kinematic, float(len(self.at)), *(v for line in lines for v in line)]

    def stress_of(self, e: Array, p: Array) -> Array:
        """Return the stress [Pa] of fibres with strains e and plastic strains p."""
        if not self.elastic:
            return self.E * (e - p)
        size = np.abs(e)
        k = np.searchsorted(self.at, size, side="right") - 1
        at, stress, slope = (np.array(v)[k] for v in (self.at, self.stress, self.slope))
        return np.asarray(np.copysign(stress + slope * (size - at), e))


def linear(E: float) -> Uniaxial:
    """Return the law of a linear elastic fibre."""
    return Uniaxial(E, (0.0,), (0.0,), (E,), elastic=True)


def hardening(E: float, stress: float, isotropic: float, kinematic: float) -> Uniaxial:
    """Return the law of a fibre with a yield stress and linear isotropic and kinematic hardening, all in Pa."""
    return Uniaxial(E, (0.0,), (stress,), (isotropic,), kinematic)


def curve(E: float, points: tuple[tuple[float, float], ...], elastic: bool) -> Uniaxial:
    """Return the law of a fibre through points (strain, stress) with positive strain; the last slope continues.

    ``elastic``: unloading follows the curve; otherwise unloading has slope E and the curve gives isotropic hardening.
    """
    slopes = [(t - s) / (b - a) for (a, s), (b, t) in pairwise([(0.0, 0.0), *points])]
    if elastic:
        strain, stress = zip((0.0, 0.0), *points[:-1], strict=True)
        return Uniaxial(E, strain, stress, tuple(slopes), elastic=True)
    (first, start), last = points[0], len(points) - 1
    if last == 0:
        # a straight line that never yields
        return linear(E)
    plastic = [b - first - (t - start) / E for b, t in points]
    rates = [(t - s) / (q - p) for (p, q), (s, t) in zip(pairwise(plastic), pairwise(t for _, t in points), strict=True)
             ]
    return Uniaxial(E, tuple(plastic[:last]), tuple(t for _, t in points[:last]), tuple(rates))


def _elastic_fibre(ref, law, eps, bend, row, stress, tangent, lanes):  # type: ignore[no-untyped-def]
    """Fill stress and tangent of an elastic fibre, whose law's numbers start at row ``law`` of ``ref``."""
    line = law + 4
    for _ in range(int(ref[law + 3, 0])):
        at, start, rise = ref[line, 0], ref[line + 1, 0], ref[line + 2, 0]
        for l in range(lanes):
            e = eps[0, l] - ref[row, l] * eps[bend, l]
            beyond = abs(e) - at
            size = start + rise * beyond
            stress[l] = stress[l] if beyond < 0.0 else size if e >= 0.0 else -size
            tangent[l] = tangent[l] if beyond < 0.0 else rise
        line += 3


def _plastic_fibre(  # type: ignore[no-untyped-def]
        ref, law, eps, bend, row, p, a, p_new, a_new, stress, tangent, lanes):
    """Fill stress, tangent, and new p and a of a plastic fibre with p and a before the step.

    The stress in excess of the yield stress is reduced line by line along the curve, without a branch in the lanes.
    Until the end, ``p_new`` holds this excess.
    """
    E, K, lines = ref[law + 1, 0], ref[law + 2, 0], int(ref[law + 3, 0])
    for k in range(lines):
        at, start, rise = ref[law + 4 + 3 * k, 0], ref[law + 5 + 3 * k, 0], ref[law + 6 + 3 * k, 0]
        for l in range(lanes):
            stress[l] = start + rise * (a[l] - at) if k == 0 or a[l] >= at else stress[l]
    least = BEYOND * ref[law + 5, 0]
    for l in range(lanes):
        e = eps[0, l] - ref[row, l] * eps[bend, l]
        beyond = abs(E * (e - p[l]) - K * p[l]) - stress[l]
        p_new[l] = beyond if beyond > least else 0.0
        a_new[l] = a[l]
        tangent[l] = E
    for k in range(lines):
        end = ref[law + 7 + 3 * k, 0] if k + 1 < lines else np.inf
        stiff = E + K + ref[law + 6 + 3 * k, 0]
        soft = E * max((stiff - E) / stiff, LEFT)
        for l in range(lanes):
            room, rest = max(end - a_new[l], 0.0), p_new[l]
            left = rest - room * stiff
            tangent[l] = soft if rest > 0.0 and room > 0.0 else tangent[l]
            a_new[l] += room if left > 0.0 else rest / stiff
            p_new[l] = left if left > 0.0 else 0.0
    for l in range(lanes):
        e, strain = eps[0, l] - ref[row, l] * eps[bend, l], a_new[l] - a[l]
        strain = p[l] + (strain if E * (e - p[l]) - K * p[l] > 0.0 else -strain)
        p_new[l], stress[l] = strain, E * (e - strain)


def _add_fibre(ref, row, E, eps, bend, p, stress, tangent, new, slope, force, lanes):  # type: ignore[no-untyped-def]
    """Add a fibre with plastic strains p to the section's sums: its forces, and their deficit to the elastic fibre."""
    n = len(eps)
    for l in range(lanes):
        y, w = ref[row, l], ref[row + 1, l]
        new[force, l] += w * stress[l]
        new[force + 1, l] -= w * y * stress[l]
    for l in range(lanes):
        y, w = ref[row, l], ref[row + 1, l]
        e = eps[0, l] - y * eps[bend, l]
        lack, size = w * (E * e - stress[l]), w * E * (abs(e) + abs(p[l]))
        new[0, l] += lack
        new[bend, l] -= y * lack
        new[n, l] += size
        new[n + bend, l] += abs(y) * size
    for l in range(lanes):
        y, soft = ref[row, l], ref[row + 1, l] * (E - tangent[l])
        slope[0, 0, l] += soft
        slope[0, bend, l] -= y * soft
        slope[bend, bend, l] += y * y * soft


def internal(ref, eps, old, new, slope, lanes):  # type: ignore[no-untyped-def]
    """Fill the internal strains and their sizes, p and a of the fibres, the section forces, and the slope.

    The last three numbers of the state are N, M and the accumulated excess of the internal strains' work, counted with
    the stress at the end of each step, over their work with the mean of the stresses at both ends.
    The last reference values of a point are (e_N, e_NM, e_M), the compliance of the elastic section; (y, w, row of
    the law) of each fibre; the laws; the row of the first fibre, and the number of fibres.
    """
    last, n = len(ref) - 1, len(eps)
    bend, first, force = 1 if n == 2 else 2, int(ref[last - 1, 0]), 2 * (n + int(ref[last, 0]))
    # used as work arrays; these rows are filled last
    stress, tangent = new[force + 2], slope[bend, 0]
    for i in range(2 * n):
        for l in range(lanes):
            new[i, l] = 0.0
    for l in range(lanes):
        slope[0, 0, l], slope[0, bend, l], slope[bend, bend, l] = 0.0, 0.0, 0.0
        new[force, l], new[force + 1, l] = 0.0, 0.0
    for f in range(int(ref[last, 0])):
        row, state = first + 3 * f, 2 * n + 2 * f
        law = int(ref[row + 2, 0])
        E = ref[law + 1, 0]
        p, a, p_new, a_new = old[state], old[state + 1], new[state], new[state + 1]
        if ref[law, 0] > 0.0:
            _elastic_fibre(ref, law, eps, bend, row, stress, tangent, lanes)
            for l in range(lanes):
                p_new[l], a_new[l] = p[l], a[l]
        else:
            _plastic_fibre(ref, law, eps, bend, row, p, a, p_new, a_new, stress, tangent, lanes)
        _add_fibre(ref, row, E, eps, bend, p_new, stress, tangent, new, slope, force, lanes)
    for l in range(lanes):
        A, C, B = ref[first - 3, l], ref[first - 2, l], ref[first - 1, l]
        N, M = new[0, l], new[bend, l]
        new[0, l], new[bend, l] = A * N + C * M, C * N + B * M
        new[force + 2, l] = old[force + 2, l] + 0.5 * (
            (new[force, l] - old[force, l]) * (new[0, l] - old[0, l])
            + (new[force + 1, l] - old[force + 1, l]) * (new[bend, l] - old[bend, l]))
        N, M = new[n, l], new[n + bend, l]
        new[n, l], new[n + bend, l] = A * N + abs(C) * M, abs(C) * N + B * M
        s, t, u = slope[0, 0, l], slope[0, bend, l], slope[bend, bend, l]
        slope[0, 0, l], slope[0, bend, l] = A * s + C * t, A * t + C * u
        slope[bend, 0, l], slope[bend, bend, l] = C * s + B * t, C * t + B * u


def extra_energy(ref: Array, D: Array, eps: Array, state: Array) -> Array:
    """Return the energy stored by fibres beyond the energy of the section forces in the elastic section.

    See ``StrainLaw``. A plastic fibre stores E (e - p)^2/2 + K p^2/2, an elastic one the integral of its stress.
    """
    row, n = ref[:, 0], eps.shape[-1]
    bend, last = 1 if n == 2 else 2, ref.shape[-1] - 1
    first, count = int(row[0, last - 1]), int(row[0, last])
    A, C, B = row[:, first - 3], row[:, first - 2], row[:, first - 1]
    length = D[:, 0, 0] * A + D[:, 0, bend] * C
    whole, p = eps + state[:, :, 0, :n], state[:, :, 0, 2 * n:2 * n + 2 * count:2]
    total, N, M = (np.zeros(eps.shape[:2]) for _ in range(3))
    for f in range(count):
        y, w, law = row[:, first + 3 * f], row[:, first + 3 * f + 1], int(row[0, first + 3 * f + 2])
        own, stress = _energy(row[0, law:], whole[..., 0] - y * whole[..., bend], p[..., f])
        total += w * own
        N += w * stress
        M -= w * y * stress
    return np.asarray(length * (total - 0.5 * (A * N * N + 2.0 * C * N * M + B * M * M)))


def _excess_work(ref: Array, D: Array, state: Array) -> Array:
    """Return the excess of the internal strains' work counted with end-of-step stresses; see ``StrainLaw``."""
    row, bend = ref[:, 0], 1 if D.shape[-1] == 2 else 2
    first = int(row[0, -2])
    length = D[:, 0, 0] * row[:, first - 3] + D[:, 0, bend] * row[:, first - 2]
    return np.asarray(length * state[:, :, 0, -1])


def _energy(numbers: Array, e: Array, p: Array) -> tuple[Array, Array]:
    """Return energy per volume and stress of fibres with strains e and plastic strains p, from a law's ``numbers``."""
    elastic, E, K, lines = numbers[0], numbers[1], numbers[2], int(numbers[3])
    if not elastic:
        return 0.5 * E * (e - p) ** 2 + 0.5 * K * p**2, E * (e - p)
    energy, stress, size = np.zeros_like(e), np.zeros_like(e), np.abs(e)
    for k in range(lines):
        at, s, slope = numbers[4 + 3 * k:7 + 3 * k]
        end = numbers[7 + 3 * k] if k + 1 < lines else np.inf
        x = np.clip(size, at, end) - at
        energy += s * x + 0.5 * slope * x**2
        stress = np.where(size >= at, s + slope * x, stress)
    return energy, np.copysign(stress, e)


def _layers(section: Section) -> list[tuple[Array, Array]]:
    """Return y [m] of the bottom and top of each layer; arrays (stations,) where the section varies."""
    if not section.layers:
        half = 0.5 * np.asarray(section.height)
        return [(-half, half)]
    return [(np.asarray(layer.bottom), np.asarray(layer.top)) for layer in section.layers]


def places(section: Section, points: int) -> tuple[Array, Array]:
    """Return y and weights b dy (fibres, stations or 1) of all fibres of a section, ``points`` in each layer."""
    x, w = gauss(points)
    y, weight = [], []
    for low, high in _layers(section):
        low, high, b = (np.atleast_1d(v)[None] for v in (low, high, section.width))
        y.append(low + x[:, None] * (high - low))
        weight.append(w[:, None] * (high - low) * b)
    return np.concatenate(y), np.concatenate(weight)


@dataclass(frozen=True)
class _Sample:
    """Sampling of a formulation whose sections have ``points`` fibres in each layer."""

    base: Formulation
    points: int

    def __call__(self, sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
        """Return (B, ref, D) as in ``Formulation.sample``."""
        # formulations without fibres were refused before
        assert self.base.fibres is not None
        xi, (B, ref, D) = self.base.fibres(sampler, rule)
        section, n = sampler.at(xi), len(xi)
        y, w = places(section, self.points)
        laws, tables = sampler.section.laws, dict.fromkeys(sampler.section.laws)
        first = ref.shape[1] + 3
        at, numbers = {}, list[float]()
        for law in tables:
            at[law] = first + 3 * len(y) + len(numbers)
            numbers += law.numbers
        det = np.asarray(section.EA * section.EI - section.ES**2)
        own = np.empty((n, 3 + 3 * len(y)))
        for k, compliance in enumerate((section.EI, section.ES, section.EA)):
            own[:, k] = compliance / det
        own[:, 3::3], own[:, 4::3], own[:, 5::3] = y.T, w.T, np.repeat([at[law] for law in laws], self.points)
        shared = np.broadcast_to([*numbers, first, len(y)], (n, len(numbers) + 2))
        return B, np.hstack([ref, own, shared]), D


@dataclass(frozen=True)
class _FibreNaturalStrains:
    """Natural strains of a section with fibres: axial strain and curvature, and of four strains that across."""

    base: Formulation

    def __call__(self, sampler: Sampler, rule: Rule, free: Free) -> Array:
        """Return the strains (stations, strains) as in ``Formulation.natural``."""
        assert self.base.fibres is not None
        xi, _ = self.base.fibres(sampler, rule)
        axial, curvature, across = of_section(sampler, free, xi)
        out = np.zeros((len(xi), self.base.law.strains))
        out[:, 0], out[:, 1 if self.base.law.strains == 2 else 2] = axial, curvature
        if self.base.law.strains == 4:
            out[:, 3] = across
        return out


@cache
def with_fibres(base: Formulation, layers: int, points: int, numbers: int) -> Formulation:
    """Return a formulation whose sections have ``points`` fibres in each of ``layers``.

    ``numbers`` is the total length of its laws' ``numbers``, each law counted once.
    """
    law, fibres = base.law, layers * points
    own = StrainLaw(law.fields, law.strains, law.references + 5 + 3 * fibres + numbers, law.strain, law.geometric,
                   quadratic=law.quadratic, state=2 * law.strains + 2 * fibres + 3, internal=internal,
                   inelastic=(0, 1 if law.strains == 2 else 2), extra_energy=extra_energy, excess_work=_excess_work)
    return replace(base, law=own, sample=_Sample(base, points), natural=_FibreNaturalStrains(base))


def fibres_of(base: Formulation, section: Section, points: int) -> Formulation:
    """Return the formulation for a section: unchanged, or with fibres if the section has fibre laws."""
    if not section.laws:
        return base
    numbers = sum(len(law.numbers) for law in dict.fromkeys(section.laws))
    return with_fibres(base, len(section.laws), points, numbers)
