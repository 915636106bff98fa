"""Loads, springs, joints, supports, masses, contact: each kind with its record, its law and its place in the model.

Each kind registers its record in its own module, and so do plugins (``ancf2d.extend``); the reader, the schema, the
reference and models find them there. The order of imports is the order in the reference.
"""

from .body_loads import Distributed, Eigenstrain, Gravity, Temperature
from .contact import Contact
from .flow import Fluid, Transport
from .forces import FollowerForce, Force, Moment, Torque
from .inertia import Mass
from .joints import PinJoint, SliderJoint, WeldJoint
from .obstacles import Circle, HalfPlane, PolylineObstacle
from .prismatic import PrismaticJoint
from .springs import RotationalSpring, TranslationalSpring
from .supports import Clamp, Fix, Pin, Prescribed, Roller
from .tendons import Tendon

__all__ = [
    "Circle", "Clamp", "Contact", "Distributed", "Eigenstrain", "Fix", "Fluid", "FollowerForce", "Force", "Gravity",
    "HalfPlane", "Mass", "Moment", "Pin", "PinJoint", "PolylineObstacle", "Prescribed", "PrismaticJoint", "Roller",
    "RotationalSpring", "SliderJoint", "Temperature", "Tendon", "Torque", "TranslationalSpring", "Transport",
    "WeldJoint",
]
