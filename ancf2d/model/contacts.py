"""The contacts of a case: their points, and checks of their reference configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..case import Case, Dynamic, Initial, QuasiStatic, Static
from ..case.schema.points import named_points
from ..elements.contact_geometry import FRICTION
from ..elements.contact_geometry import STICK as STIFF
from ..elements.shape import Array
from ..interactions.body_contact import BodyPair, body_pairs
from ..interactions.contact import STICK, CompliantContact, ContactPair, ContactPoint
from ..interactions.contact_curves import driven, movable
from ..interactions.obstacles import Frame
from .mesh import BodyMesh

if TYPE_CHECKING:
    from .point_tables import Interactions

# largest overlap in the reference, relative to the extent of a model
OVERLAP = 1e-9
# the same for elements that only approximate a curve
SLIGHT = 1e-5
# the same with a law, relative to the length of a body: such an overlap may be intended
DEEP = 0.01
# number of movable points between fixed ones in statics: that many coordinates of two bodies are across this interval,
# so forces at more places depend on each other
BETWEEN = 2
# lengths of a held body beyond which it cannot reach an obstacle
REACH = 2.5
# slip of a sticking rigid body under all forces of the scene, relative to its extent; number of load factors sampled
SLIP, FACTORS = 1e-6, 16
# rate of sticking bodies relative to that of time steps; assumed step, as a share of t_end, if dt is not given
RAPID, AT_LEAST = 1e3, 1e-3


def rapid_rate(case: Case) -> float:
    """Return a rate [1/s] far above what the time steps of a motion resolve; 0 in statics."""
    if not isinstance(case.solver, Dynamic):
        return 0.0
    return RAPID / (case.solver.dt or AT_LEAST * case.solver.t_end)


@dataclass
class Contacts:
    """The contact points of all contact pairs, as constraints (without a law) and springs (with a law).

    ``e0`` (n_q,) is the reference, ``extent`` its size, ``follows`` the dependent coordinates (see
    ``numbering.Dependent``), ``begin`` the time or load factor of the reference; ``starts``: a motion starts from this
    static case. ``problems`` are (path in the case, message, what was expected).
    """

    case: Case
    meshes: dict[str, BodyMesh]
    frames: dict[str, Frame]
    e0: Array
    extent: float
    follows: Mapping[int, Any]
    begin: float
    starts: bool = False
    pairs: list[ContactPair | BodyPair] = field(default_factory=list)
    constraints: list[ContactPoint] = field(default_factory=list)
    springs: list[CompliantContact] = field(default_factory=list)
    problems: list[tuple[tuple[str, int], str, str]] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        named = {name for item in self.case.contacts for name in item.between or ()}
        self.warnings += [f"obstacles.{name}: no contact names this obstacle, so it has no effect"
                          for name in self.case.obstacles if name not in named]
        for i, item in enumerate(self.case.contacts):
            self._warn_of_assumed_height(i, item)
            for pair in self._pairs(i, item):
                self.pairs.append(pair)
                if pair.hard:
                    self.constraints += [ContactPoint(pair, k) for k in range(len(pair.spots))]
                else:
                    self.springs.append(CompliantContact(pair))

    def _pairs(self, i: int, item: Any) -> list[Any]:
        body, other = (item.self_, item.self_) if item.between is None else item.between
        name = item.name or f"{body}-{other}"
        # contact points move along elements only in statics without a law
        moving = isinstance(self.case.solver, Dynamic)
        places_move = not moving and item.law is None
        if body in self.case.obstacles:
            body, other = other, body
        if other in self.case.obstacles:
            if not movable(self.meshes[body], item.side, item.law is not None, self.follows, places_move):
                self.problems.append((("contacts", i), f"contacts.{i}: supports hold all of {body}, which cannot touch "
                                      f"{other}", "a body that moves"))
                return []
            pair = ContactPair(item, name, self.meshes[body], self.case.obstacles[other], self.frames[other],
                               self.extent, self.follows, rapid_rate(self.case), places_move=places_move)
            pair.other = other
            held = driven(self.meshes[body], item.side, self.follows)
            if held and pair.hard:
                own = ContactPair(item, name, self.meshes[body], self.case.obstacles[other], self.frames[other],
                                  self.extent, chosen=held)
                own.other, pair.driven = other, (own, own.gaps(np.zeros(len(self.e0)), self.begin))
            self._check_overlap(i, pair)
            return [pair]
        # pressure fades as in the motion that starts, which else would not start in equilibrium
        rapid = RAPID if self.starts and item.law is not None else rapid_rate(self.case)
        pairs = body_pairs(item, name, self.meshes[body], self.meshes[other], self.extent, rapid,
                           self.follows if moving else {}, self._joined(body, other), 0 if moving else BETWEEN)
        if pairs:
            self._check_overlap_of_bodies(i, pairs)
        else:
            self.problems.append((("contacts", i), f"contacts.{i}: all of {body} and {other} is so near to a joint of "
                                  "both that nothing can touch", "bodies that are longer than they are high"))
        return pairs

    def _joined(self, body: str, other: str) -> list[tuple[float, float]]:
        """Return the pairs of places [m] on two bodies that joints hold together."""
        at = [named_points(joint) for joint in self.case.joints if joint.active is None or not joint.active.begins]
        return [(p.s * self.meshes[body].plan.length, q.s * self.meshes[other].plan.length)
                for points in at for p in points for q in points if (p.body, q.body) == (body, other) and p != q]

    def _warn_of_assumed_height(self, i: int, item: Any) -> None:
        """Warn if a body without a section touches with its faces, whose distance from the axis is then assumed."""
        bodies = [name for name in item.between or () if name in self.meshes] if item.side == "surface" else []
        self.warnings += [f"contacts.{i}: {name} has no section, so its faces are taken to be "
                          f"{0.5 * self.meshes[name].plan.section.height:.3g} from its axis. Give it a section, or use "
                          "side: axis" for name in bodies if self.case.bodies[name].section is None]

    @property
    def _from_reference(self) -> bool:
        """Whether the solution starts from the reference, and not from the state of a result file."""
        return not isinstance(self.case.solver, Dynamic) or (self.case.initial or Initial()).from_ in ("rest", "static")

    def _check_overlap(self, i: int, pair: ContactPair) -> None:
        """Report a body that overlaps an obstacle in the reference, or that cannot reach it."""
        if not self._from_reference:
            return
        gaps = pair.gaps(np.zeros(len(self.e0)), self.begin)
        k, obstacle = int(np.argmin(gaps)), self.case.obstacles[pair.other]
        if self._may_overlap(pair, -gaps[k]):
            # equilibria remove the overlap; a motion must start with it, so the surface is shifted
            if isinstance(self.case.solver, Dynamic):
                pair.set_back(-gaps[k])
        elif pair.hard and gaps[k] < -OVERLAP * self.extent:
            slight = -gaps[k] < SLIGHT * self.extent
            where = "a small gap between them" if slight else f"{pair.body} {obstacle.region(pair.other)}"
            self.problems.append((("contacts", i), f"contacts.{i}: {pair.body} and {pair.other} overlap in the "
                                  f"reference, by up to {-gaps[k]:.4g} at S = {pair.s[k]:.4g}",
                                  f"{where}, or a law"))
        if not pair.hard:
            self._warn_of_depth(i, pair, -gaps[k], pair.s[k])
        mesh = pair.mesh
        x = np.flatnonzero(mesh.kinds == 0) + mesh.first_dof
        holds = any(c in self.follows and not self.follows[c].terms and c + 1 in self.follows
                    and not self.follows[c + 1].terms for c in x.tolist())
        rests = not pair.frame.signals and not pair.frame.fields
        if holds and rests and gaps[k] > REACH * mesh.plan.length:
            self.warnings.append(f"contacts.{i}: {pair.body} is held {gaps[k]:.4g} from {pair.other}, more than "
                                 f"{REACH:g} times its length: they touch only if a support moves it there")

    def _may_overlap(self, pair: ContactPair, depth: float) -> bool:
        """Return whether elements may overlap an obstacle by ``depth`` [m], as they only approximate their curve."""
        solver = self.case.solver
        if not (pair.hard and OVERLAP * self.extent < depth < SLIGHT * self.extent
                and any(p.kappa != 0.0 for p in pair.mesh.plan.pieces)):
            return False
        if isinstance(solver, Dynamic):
            return self.case.obstacles[pair.other].smooth
        return isinstance(solver, Static | QuasiStatic)

    def _warn_of_depth(self, i: int, pair: ContactPair | BodyPair, depth: float, s: float) -> None:
        """Warn if a contact with a law starts with a large overlap."""
        if depth > DEEP * pair.mesh.plan.length:
            other = "itself" if pair.other == pair.body else pair.other
            self.warnings.append(f"contacts.{i}: {pair.body} and {other} overlap in the reference, by up to "
                                 f"{depth:.4g} at S = {s:.4g}, so the law pushes them apart from the start. Move them "
                                 "apart unless this is meant")

    def _check_overlap_of_bodies(self, i: int, pairs: list[BodyPair]) -> None:
        """Report bodies that overlap in the reference."""
        if not self._from_reference:
            return
        found = [(*pair.overlap(), pair) for pair in pairs]
        depth, s, pair = max(found, key=lambda one: one[0])
        if not pair.hard:
            self._warn_of_depth(i, pair, depth, s)
        elif depth > OVERLAP * self.extent:
            other = "itself" if pair.other == pair.body else pair.other
            self.problems.append((("contacts", i), f"contacts.{i}: {pair.body} is {depth:.4g} deep in {other} in the "
                                  f"reference, at S = {s:.4g}", "bodies that do not overlap, or a law"))


def set_stick_stiffness(model: Any, acts: Interactions) -> None:
    """Set the sticking stiffness of rigid bodies in statics: all loads stretch it by 1e-6 of the extent at most.

    It is at least 100 times that of the stiffest spring or element: motions can press without loads, too.
    """
    held = [c for c in model.constraints
            if isinstance(c, ContactPoint) and c.par[FRICTION] > 0.0 and c.par[STIFF] == 0.0]
    if not held:
        return
    d, last = np.zeros(len(model.numbering.place)), getattr(model.case.solver, "t_end", 1.0)
    w = np.append(model.weights, np.full(len(d) - model.n_q, np.inf))
    forces, stiffness = 0.0, [float(mesh.plan.section.EA / np.min(mesh.lengths))
                              for mesh in model.meshes.values() if not mesh.plan.rigid]
    for t in np.linspace(0.0, last, FACTORS + 1).tolist():
        found = [(model.external(t), w)] + [
            (batch.evaluate(model.e0, d, t)[1], w[batch.dofs]) for batch in (*acts.loads, *acts.springs)]
        forces = max(forces, sum(float(np.abs(Q / size).sum()) for Q, size in found))
    for batch in acts.springs:
        w_i = w[batch.dofs]
        K = batch.evaluate(model.e0, d, 0.0)[2] / (w_i[:, :, None] * w_i[:, None, :])
        stiffness.append(float(np.abs(K).max(initial=0.0)))
    firm = max(forces / (SLIP * model.extent), STICK * max(stiffness, default=0.0)) or 1.0
    for point in held:
        point.par[STIFF] = firm
