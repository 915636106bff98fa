"""Loads, springs, joints, supports, masses, contact: each kind with its record, its law and its place in the model.

Each module registers its records, and so do plugins (``ancf2d.extend``); the reader, the schema, the reference and
models find them there. The order of imports is the order in the reference.
"""

from . import body_loads, contact, flow, forces, inertia, joints, obstacles, prismatic, springs, supports, tendons

__all__ = ["body_loads", "contact", "flow", "forces", "inertia", "joints", "obstacles", "prismatic", "springs",
           "supports", "tendons"]
