"""Warnings about a whole motion: a missed tolerance, lost or gained energy, rotations larger than displacements."""

from __future__ import annotations

import numpy as np

from ...elements.shape import Array
from ...errors import percent
from ...kernels.motion.state import COUNT
from ...model.model import Model
from ...model.timing import rates_of
from .integrators import INTEGRATORS, default_method
from .stepping import Stepper

# multiple of the tolerance above which errors cause a warning; with the default tolerance only larger ones than USELESS
MISSED, USELESS = 10.0, 0.1
# if ten times the tolerance changes the error by less than this factor, the error does not depend on it
ASYMPTOTIC = 2.0**0.5
# smallest share of the tolerance that is recommended: errors were observed with up to a hundred times the tolerance
SMALLEST = 0.01
# error of the energy balance, relative to the energy, that is allowed without a warning
DRIFT_ALLOWED = 0.01
# as DRIFT_ALLOWED, for motions with fibres that yield, whatever the estimated error
FIBRE_DRIFT_ALLOWED = 0.1
# energy that contact may add without a warning, relative to the energy
GAIN_ALLOWED = 0.02
# displacements by rotation (times half the section height) may be this many times the other ones without a warning
ROTATIONS_ALLOWED = 10.0


def missed_tolerance(stepper: Stepper, estimate: float, order: float) -> list[str]:
    """Return a warning that the error is far above the tolerance, and whether steps or motion cause it.

    ``order``: the observed power of the tolerance with which errors grow.
    """
    case, tolerance, count = stepper.model.case, stepper.tolerance, int(stepper.s.numbers[COUNT])
    allowed = USELESS if getattr(case.solver, "tolerance", None) is None else MISSED * tolerance
    # the accuracy control judges the runs itself
    if estimate <= allowed or case.accuracy is not None:
        return []
    said = (f"the tolerance is missed: the estimated error is {estimate:.2g} of the largest displacements, "
            f"{estimate / tolerance:.0f} times the tolerance {tolerance:g}. ")
    if estimate > count * tolerance:
        # errors that do not grow add up to at most the number of steps times the tolerance
        return [said + "The errors grow, because the motion is sensitive to its initial state, like chaotic motions. A "
                "smaller tolerance only postpones the time from which the motion is unreliable; its statistics may "
                "still be right"]
    if 10.0 ** order < ASYMPTOTIC:
        return [said + "Ten times the tolerance gives about the same error: the steps skip fast vibrations, which "
                "only a much smaller tolerance resolves. If these vibrations do not matter, use a larger tolerance"
                + _better(stepper) + _jump(stepper)]
    power = min(order, 1.0)
    share = max(min((MISSED * tolerance / estimate) ** (1.0 / power), 0.5), SMALLEST)
    # with shorter steps, more errors add up: they may be as many times the smaller tolerance, so the error is named
    return [said + f"Each step meets the tolerance, but the errors add up. Use a tolerance of about "
            f"{share * tolerance:.1g} for an error of about {share**power * estimate:.1g}, or --accuracy with a goal, "
            "which limits the error of the whole motion" + _better(stepper) + _jump(stepper)]


def _better(stepper: Stepper) -> str:
    """Return advice to use the recommended method if its order is higher: it errs less with fewer steps."""
    best = INTEGRATORS[default_method(stepper.model)]
    better = best.order > stepper.method.order
    return f". Method {best.name} has a smaller error with fewer steps" if better else ""


def _jump(stepper: Stepper) -> str:
    """Return a hint if a prescribed motion starts a model at rest with a jump of velocity, like an impact."""
    model = stepper.model
    # moving obstacles move nothing before they touch
    obstacles = [s for pair in model.contacts for s in pair.signal or ()]
    signals = [stepper.signals[k] for k in stepper.driving]
    if model.case.initial is not None or not any(rates_of(s, 0.0)[0] for s in signals if s not in obstacles):
        return ""
    return (". A prescribed motion begins at full speed, which excites vibrations like an impact. Let it begin "
            "gradually, or give initial velocities")


def gain_warning(model: Model, gain: float) -> list[str]:
    """Return a warning if contact layers have added energy; ``gain`` is that of the model, relative to its energy."""
    layers = dict.fromkeys(pair.name for pair in model.contacts if not pair.hard)
    if gain <= GAIN_ALLOWED or not layers:
        return []
    return [f"the motion has gained {percent(gain)} of its energy by numerical errors: the steps are too long for "
            f"the contact layer ({', '.join(layers)}). Use shorter steps, a (smaller) tolerance, a softer law, or no "
            "law. If this does not help, points have passed the middle of the body that they touch: use a stiffer "
            "law, or none"]


def wound_warning(model: Model, d: Array) -> list[str]:
    """Return a warning if rotations have grown far beyond all displacements under adaptive steps.

    Local errors are relative to the largest displacement, and an angle counts as the displacement that it causes: after
    many turns, this exceeds the displacement of every point by far.
    """
    angles = np.concatenate([mesh.kinds == 2 for mesh in model.meshes.values()])
    moved = model.weights * np.abs(d[:model.n_q])
    wound = float(np.max(moved, where=angles, initial=0.0))
    share = wound / max(float(np.max(moved, where=~angles, initial=0.0)), model.extent)
    if share <= ROTATIONS_ALLOWED:
        return []
    return ["the error of the steps is larger than the tolerance suggests: the tolerance is relative to the largest "
            f"displacement, including rotations, which is {share:.2g} times the largest displacement of a point. Use a "
            "tolerance as many times smaller, or a type without angles as coordinates, such as vallejo"]


def drift_warning(drift: float, estimate: float | None, struck: bool) -> list[str]:
    """Return a warning if the error of the energy balance is much larger than the estimated error."""
    if estimate is None or drift <= max(DRIFT_ALLOWED, 10.0 * estimate):
        return []
    if struck:
        return [f"impacts start vibrations that the method damps where the steps do not resolve them: the energy "
                f"balance has an error of {percent(drift)}, and the estimated error of displacements is "
                f"{percent(estimate)}. Shorter steps, or a smaller tolerance, keep more of the vibrations; a "
                "contact law softens impacts"]
    return [f"the steps are too long for part of the motion: the energy balance has an error of {percent(drift)}, "
            f"but the estimated error is only {percent(estimate)}. Use shorter steps to find out which is right"]


def fibres_warning(model: Model, drift: float) -> list[str]:
    """Return a warning if the energy balance is far off in a model with fibres that yield."""
    if drift <= FIBRE_DRIFT_ALLOWED or not model.hardens:
        return []
    return [f"the energy balance is off by {percent(drift)}: fibres remember the peaks of vibrations that steps do "
            "not resolve. Use shorter steps, or radau5, which damps them"]
