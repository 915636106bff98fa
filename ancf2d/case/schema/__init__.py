"""The case format as frozen dataclasses; each field has its kind, unit, bounds and meaning.

To add a solver or amplitude, write a dataclass with a ``tag`` (its ``type`` in a case) and add it to the union of its
module. Loads, joints, supports, springs and masses are in ``ancf2d/interactions`` and in plugins, which register them.
"""

from .active import SWITCHED, Active, Gated, Latch, Windowed, amplitude_of
from .amplitudes import Amplitude, Constant, Expression, Ramp, Sine, Table
from .body import (
    AreaSection,
    Body,
    Element,
    Layers,
    Rectangle,
    Section,
    Selective,
    Stiffness,
)
from .case import (
    BodyInitial,
    Case,
    Damping,
    Initial,
    Rayleigh,
    RotationRate,
    SteadyRotation,
    register,
)
from .controllers import Controller, Pid, StateController
from .geometry import Arc, ArcPiece, CurveGeometry, Geometry, Line, LinePiece, PathGeometry, Polyline, Spline
from .materials import Material, MaterialDamping, MaxwellTerm, StressStrain
from .output import Expected, Goal, Output, Units
from .points import GroundPoint, MovingPoint, Point, Probe
from .profiles import PointExpression, Profile, ProfileExpression, ProfileTable
from .solvers import (
    Buckling,
    Dynamic,
    Eigen,
    FrequencyResponse,
    LimitPoints,
    LinearStatic,
    LoadFactor,
    ProbeReaches,
    QuasiStatic,
    SmallMotions,
    Solver,
    StateSpace,
    Static,
)

__all__ = [
    "SWITCHED", "Active", "Amplitude", "Arc", "ArcPiece", "AreaSection", "Body", "BodyInitial", "Buckling", "Case",
    "Constant",
    "Controller", "CurveGeometry", "Damping", "Dynamic", "Eigen", "Element", "Expected", "Expression",
    "FrequencyResponse", "Gated", "Geometry", "Goal", "GroundPoint", "Initial", "Latch", "Layers", "LimitPoints",
    "Line", "LinePiece", "LinearStatic", "LoadFactor", "Material", "MaterialDamping", "MaxwellTerm", "MovingPoint",
    "Output", "PathGeometry", "Pid", "Point", "PointExpression", "Polyline", "Probe", "ProbeReaches", "Profile",
    "ProfileExpression", "ProfileTable", "QuasiStatic", "Ramp", "Rayleigh", "Rectangle", "RotationRate", "Section",
    "Selective", "Sine", "SmallMotions", "Solver", "Spline", "StateController", "StateSpace", "Static",
    "SteadyRotation", "Stiffness", "StressStrain", "Table", "Units", "Windowed", "amplitude_of",
    "register",
]
