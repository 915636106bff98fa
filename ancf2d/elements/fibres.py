"""Sections of fibres along the axis, each with a uniaxial law of its own: plastic, or nonlinear elastic.

A formulation whose strains tell the strain e = eps - y kappa of every fibre can have them. Its section forces are sums
over Gauss points through the height of each layer, N = sum w s and M = -sum w y s. Kernels have them as those of the
elastic section, D (eps - eps_i), with internal strains eps_i that bear what the fibres do not: shear stays elastic.

The law of a fibre is that of rate-independent plasticity with isotropic and linear kinematic hardening: with the
plastic strain p and its sum of magnitudes a, |E (e - p) - K p| <= s(a). The return map is exact in a step of one
direction (Simo & Hughes 1998, section 1.4), and so is its derivative, the consistent tangent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise

import numpy as np

from .formulations.base import Formulation, Free, PointLaw, Rule, Sampler, of_section
from .section import Section
from .shape import Array, gauss

# a fibre is plastic that is this much beyond its yield stress: one at the end of an accepted step is not
BEYOND = 1e-10
# of E: tangent of a fibre that bears no more, so that a section in which all yield leaves a matrix that can be solved.
# Where two such sections meet at a node, how their hinge is divided between them is not determined: with less than
# this, what is left of a residual would turn the node further than fibres take to yield and unload
LEFT = 1e-6
# of E: slope in the end below which a section of fibres that yield is a hinge
FLOWS = 0.01
# Gauss points through the height of each layer, where a case says nothing of them
FIBRES = 16


@dataclass(frozen=True)
class Uniaxial:
    """The stress of a fibre: E [Pa] at first, then straight lines that begin at ``at`` with ``stress`` and ``slope``.

    Of an ``elastic`` law, ``at`` are strains from 0 on; else plastic strains from 0 on, where the stress is the yield
    stress, and ``kinematic`` [Pa] shifts it per plastic strain.
    """

    E: float
    at: tuple[float, ...]
    stress: tuple[float, ...]
    slope: tuple[float, ...]
    kinematic: float = 0.0
    elastic: bool = False

    @property
    def flows(self) -> bool:
        """Whether the fibre yields and in the end bears hardly more, so that a section of such can be a hinge."""
        return not self.elastic and self.slope[-1] + self.kinematic < FLOWS * self.E

    @property
    def numbers(self) -> list[float]:
        """All constants in a row, as ``internal`` reads them."""
        lines = zip(self.at, self.stress, self.slope, strict=True)
        return [float(self.elastic), self.E, self.kinematic, float(len(self.at)), *(v for line in lines for v in line)]

    def stress_of(self, e: Array, p: Array) -> Array:
        """Return the stress [Pa] of fibres strained by e, whose plastic strains are p."""
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
    """Return the law of a fibre that yields at a stress and hardens linearly, all in Pa."""
    return Uniaxial(E, (0.0,), (stress,), (isotropic,), kinematic)


def curve(E: float, points: tuple[tuple[float, float], ...], elastic: bool) -> Uniaxial:
    """Return the law of a fibre by points (strain, stress) beyond zero; the last slope goes on.

    ``elastic``: it unloads along the curve; else with E, and the curve tells isotropic hardening.
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


def _along(ref, law, eps, bend, row, stress, tangent, lanes):  # type: ignore[no-untyped-def]
    """Fill stress and tangent of an elastic fibre, whose law's numbers stand in ``ref`` from row ``law`` on."""
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


def _yielded(ref, law, eps, bend, row, p, a, over, gone, stress, tangent, lanes):  # type: ignore[no-untyped-def]
    """Fill stress and tangent of a plastic fibre with plastic strains p and a; ``over`` and ``gone`` become the new.

    What the stress exceeds that of yielding by is taken line by line of the curve, without a branch in the lanes.
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
        over[l] = beyond if beyond > least else 0.0
        gone[l] = a[l]
        tangent[l] = E
    for k in range(lines):
        end = ref[law + 7 + 3 * k, 0] if k + 1 < lines else np.inf
        stiff = E + K + ref[law + 6 + 3 * k, 0]
        soft = E * max((stiff - E) / stiff, LEFT)
        for l in range(lanes):
            room, rest = max(end - gone[l], 0.0), over[l]
            left = rest - room * stiff
            tangent[l] = soft if rest > 0.0 and room > 0.0 else tangent[l]
            gone[l] += room if left > 0.0 else rest / stiff
            over[l] = left if left > 0.0 else 0.0
    for l in range(lanes):
        e, strain = eps[0, l] - ref[row, l] * eps[bend, l], gone[l] - a[l]
        strain = p[l] + (strain if E * (e - p[l]) - K * p[l] > 0.0 else -strain)
        over[l], stress[l] = strain, E * (e - strain)


def _add_fibre(ref, row, E, eps, bend, p, stress, tangent, new, slope, force, lanes):  # type: ignore[no-untyped-def]
    """Add what a fibre with plastic strains p bears to the sums of its section, and lacks of the elastic fibre."""
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
    """Fill the internal strains with their sizes, the fibres' plastic strains p and a, forces and work, and slope.

    The last of the state are N, M and by how much the internal strains have taken less than those of each step under
    the stress at its end: they have under the mean of its stresses at both ends.
    The last reference values of a point are (e_N, e_NM, e_M), the compliance of the elastic section; (y, w, place of
    the law) of each fibre; the laws; the place of the first fibre, and the number of fibres.
    """
    last, n = len(ref) - 1, len(eps)
    bend, first, force = 1 if n == 2 else 2, int(ref[last - 1, 0]), 2 * (n + int(ref[last, 0]))
    # rows that are filled last
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
            _along(ref, law, eps, bend, row, stress, tangent, lanes)
            for l in range(lanes):
                p_new[l], a_new[l] = p[l], a[l]
        else:
            _yielded(ref, law, eps, bend, row, p, a, p_new, a_new, stress, tangent, lanes)
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


def stored(ref: Array, D: Array, eps: Array, state: Array) -> Array:
    """Return what fibres store beyond the energy of the section's forces in the elastic section; see ``PointLaw``.

    A fibre that yields has E (e - p)^2/2 + K p^2/2, another one its stress summed over its strain.
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


def _overtold(ref: Array, D: Array, state: Array) -> Array:
    """Return what the internal strains took less than was told at the ends of steps; see ``PointLaw``."""
    row, bend = ref[:, 0], 1 if D.shape[-1] == 2 else 2
    first = int(row[0, -2])
    length = D[:, 0, 0] * row[:, first - 3] + D[:, 0, bend] * row[:, first - 2]
    return np.asarray(length * state[:, :, 0, -1])


def _energy(numbers: Array, e: Array, p: Array) -> tuple[Array, Array]:
    """Return energy per volume and stress of fibres strained by e with plastic strains p, by the numbers of a law."""
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
    """Return (bottom, top) of each layer as shares of the height, where sections vary arrays (stations,)."""
    if not section.layers:
        half = 0.5 * np.asarray(section.height)
        return [(-half, half)]
    return [(np.asarray(layer.bottom), np.asarray(layer.top)) for layer in section.layers]


def places(section: Section, points: int) -> tuple[Array, Array]:
    """Return y and weights b dy (fibres, stations or 1) of the fibres of a section, ``points`` in each layer."""
    x, w = gauss(points)
    y, weight = [], []
    for low, high in _layers(section):
        low, high, b = (np.atleast_1d(v)[None] for v in (low, high, section.width))
        y.append(low + x[:, None] * (high - low))
        weight.append(w[:, None] * (high - low) * b)
    return np.concatenate(y), np.concatenate(weight)


@dataclass(frozen=True)
class _Sample:
    """Samples a formulation whose sections have ``points`` fibres in each layer."""

    base: Formulation
    points: int

    def __call__(self, sampler: Sampler, rule: Rule) -> tuple[Array, Array, Array]:
        """Return (B, ref, D) as ``Formulation.sample`` does."""
        # formulations without fibres have been refused
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
class _Natural:
    """What strains such a section when it is free: axial strain, curvature, and strain across where it has one."""

    base: Formulation

    def __call__(self, sampler: Sampler, rule: Rule, free: Free) -> Array:
        """Return strains (stations, strains) as ``Formulation.natural`` does."""
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

    ``numbers`` are those of its laws together, each once.
    """
    law, fibres = base.law, layers * points
    own = PointLaw(law.fields, law.strains, law.references + 5 + 3 * fibres + numbers, law.strain, law.geometric,
                   quadratic=law.quadratic, state=2 * law.strains + 2 * fibres + 3, internal=internal,
                   stored=stored, overtold=_overtold)
    return replace(base, law=own, sample=_Sample(base, points), natural=_Natural(base))


def fibres_of(base: Formulation, section: Section, points: int) -> Formulation:
    """Return a formulation for a section: itself, or that with fibres where the section has laws of its own."""
    if not section.laws:
        return base
    numbers = sum(len(law.numbers) for law in dict.fromkeys(section.laws))
    return with_fibres(base, len(section.laws), points, numbers)
