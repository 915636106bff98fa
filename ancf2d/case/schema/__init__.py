"""The case format as frozen dataclasses; each field says its kind, unit, bounds and meaning.

A further load, joint, support, spring, solver or amplitude is one more dataclass with a ``tag``
(what ``type`` says of it), named in the union of its module.
"""

from .amplitudes import Amplitude, Constant, Expression, Ramp, Sine, Table
from .body import (
    Arc,
    AreaSection,
    Body,
    Element,
    Geometry,
    Line,
    Material,
    MaterialDamping,
    Polyline,
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
)
from .joints import (
    Joint,
    Mass,
    PinJoint,
    PrismaticJoint,
    RotationalSpring,
    SliderJoint,
    Spring,
    TranslationalSpring,
    WeldJoint,
)
from .loads import Distributed, FollowerForce, Force, Gravity, Load, Moment
from .output import Expected, Goal, Output, Units
from .points import GroundPoint, Point, Probe
from .solvers import (
    Buckling,
    Dynamic,
    Eigen,
    FrequencyResponse,
    LimitPoints,
    LinearStatic,
    LoadFactor,
    ProbeReaches,
    SmallMotions,
    Solver,
    StateSpace,
    Static,
)
from .supports import Clamp, Fix, Pin, Prescribed, Roller, Support

__all__ = [
    "Amplitude", "Arc", "AreaSection", "Body", "BodyInitial", "Buckling", "Case", "Clamp",
    "Constant", "Damping", "Distributed", "Dynamic", "Eigen", "Element", "Expected", "Expression",
    "Fix", "FollowerForce", "Force", "FrequencyResponse", "Geometry", "Goal", "Gravity", "GroundPoint", "Initial",
    "Joint", "LimitPoints", "Line", "LinearStatic", "Load", "LoadFactor", "Mass", "Material",
    "MaterialDamping", "Moment", "Output", "Pin", "PinJoint", "Point", "Polyline", "Prescribed",
    "PrismaticJoint", "Probe", "ProbeReaches", "Ramp", "Rayleigh", "Rectangle", "Roller",
    "RotationRate", "RotationalSpring", "Section", "Selective", "Sine", "SliderJoint", "SmallMotions", "Solver",
    "Spring", "StateSpace", "Static", "SteadyRotation", "Stiffness", "Support", "Table", "TranslationalSpring",
    "Units", "WeldJoint",
]
