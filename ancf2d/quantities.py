"""The quantities of probes and reactions, which results report and goals name: kind, meaning and rate of each."""

from __future__ import annotations

from dataclasses import dataclass

# the SI unit of each kind
_UNITS = {"position": "m", "displacement": "m", "rotation": "rad", "velocity": "m/s", "angular velocity": "rad/s",
          "force": "N", "moment": "N m"}


@dataclass(frozen=True)
class Quantity:
    """A quantity. Those of one kind have one unit and one scale: values tiny beside the largest are round-off."""

    name: str
    kind: str
    words: str
    # name of the time derivative, empty if results do not contain it
    rate: str = ""


QUANTITIES = {q.name: q for q in (
    Quantity("x", "position", "position in x", "vx"), Quantity("y", "position", "position in y", "vy"),
    Quantity("ux", "displacement", "displacement in x", "vx"),
    Quantity("uy", "displacement", "displacement in y", "vy"),
    Quantity("theta", "rotation", "rotation of the section from the reference, counted through full turns", "omega"),
    Quantity("vx", "velocity", "velocity in x"), Quantity("vy", "velocity", "velocity in y"),
    Quantity("omega", "angular velocity", "angular velocity of the section"),
    Quantity("N", "force", "axial force, tension positive"), Quantity("Q", "force", "shear force"),
    Quantity("M", "moment", "bending moment"),
    Quantity("fx", "force", "force in x"), Quantity("fy", "force", "force in y"), Quantity("m", "moment", "moment"),
)}
KIND_OF = {name: q.kind for name, q in QUANTITIES.items()}
UNIT_OF = {name: _UNITS[kind] for name, kind in KIND_OF.items()}
RATE_OF = {name: q.rate for name, q in QUANTITIES.items() if q.rate}
MOTIONS = tuple(RATE_OF)
RATES = tuple(dict.fromkeys(RATE_OF.values()))
# everything that describes the motion of a probe: expressions may use these
KINEMATIC = (*MOTIONS, *RATES)
# positions and rates follow from these
DISPLACEMENTS = ("ux", "uy", "theta")
FORCES = ("N", "Q", "M")
REACTIONS = ("fx", "fy", "m")
