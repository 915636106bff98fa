"""The list of all formulations of the elastic forces; new ones are added here."""

from . import cable, green, reissner, structural
from .base import Formulation, Rule, Sampler, strains_at

FORMULATIONS: dict[str, Formulation] = {
    f.name: f for module in (green, structural, cable, reissner) for f in module.FORMULATIONS
}

__all__ = ["FORMULATIONS", "Formulation", "Rule", "Sampler", "strains_at"]
