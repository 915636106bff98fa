"""Materials: elastic constants and other stress-strain laws."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from ..binder import Issue
from ..declare import key, record
from ..kinds import Choice, ListOf, Number
from ..records import Record
from .profiles import Profile, ProfileOf

# allowed relative difference between a given E and the first slope of a curve
FIRST_SLOPE = 1e-3


@record
class MaterialDamping:
    """Damping of the material."""

    kelvin_voigt: float = key(Number("s", ge=0), "Retardation time tau: stress = D (eps + tau "
                              "d eps/dt)", example=1e-4)


@record
class LinearHardening:
    """How the yield stress changes with plastic strain."""

    isotropic: float = key(Number("Pa", ge=0), "Increase of the yield stress per plastic strain, in both directions",
                           default=0.0, example=1e9)
    kinematic: float = key(Number("Pa", ge=0), "Shift of the yield stress per plastic strain, in its direction",
                           default=0.0, example=1e9)


@record
class StressStrain:
    """A measured uniaxial stress-strain curve, odd in strain, extended with its last slope."""

    strain: tuple[float, ...] = key(ListOf(Number("", ge=0), "numbers", 1), "Strains, in ascending order",
                                    example=[0.00125, 0.02])
    stress: tuple[float, ...] = key(ListOf(Number("Pa", ge=0), "numbers", 1), "Stress at each strain, never decreasing",
                                    example=[2.5e8, 3.0e8])
    unloading: str = key(Choice("elastic", "curve"), "elastic: a metal, which unloads with E and hardens "
                         "isotropically; curve: nonlinear elastic, unloads along the curve", default="elastic")

    @property
    def points(self) -> tuple[tuple[float, float], ...]:
        """Strain and stress of each point except (0, 0)."""
        return tuple(p for p in zip(self.strain, self.stress, strict=True) if p != (0.0, 0.0))

    def check(self) -> Iterator[Issue]:
        """Yield an issue if the lists do not form a valid curve."""
        if len(self.strain) != len(self.stress):
            yield Issue(("stress",), f"{{}}: strain has {len(self.strain)} numbers and stress has {len(self.stress)}",
                        "as many stresses as strains")
            return
        if not self.points or self.points[0][0] == 0.0 or self.points[0][1] == 0.0:
            yield Issue(("stress",), "{}: the first point beyond zero must have a positive strain and stress")
            return
        for i, ((a, s), (b, t)) in enumerate(pairwise(zip(self.strain, self.stress, strict=True)), 1):
            if not a < b:
                yield Issue(("strain", i), f"{{}}.strain must increase, got {b:g} after {a:g}")
                return
            if t < s:
                yield Issue(("stress", i), f"{{}}.stress must not fall, got {t:g} after {s:g}", "a curve without "
                            "softening, which would depend on the mesh")
                return


@record
class MaxwellTerm:
    """A spring in series with a dashpot, parallel to the long-time stiffness."""

    modulus: float = key(Number("", gt=0), "Modulus of the spring, relative to E", example=0.5)
    time: float = key(Number("s", gt=0), "Relaxation time", example=0.1)


# common names of keys of a material -> the keys here
OTHERS = {
    "density": "rho", "young": "E", "youngs_modulus": "E", "youngs": "E", "modulus": "E", "elastic_modulus": "E",
    "poisson": "nu", "poissons_ratio": "nu", "poisson_ratio": "nu", "expansion": "alpha", "yield_stress": "yield",
}


@record
class Material:
    """An isotropic material, linear elastic by default."""

    other_names = OTHERS
    E: float | Profile | None = key(ProfileOf("Pa", gt=0), "Young's modulus", default=None, example=2.07e11)
    nu: float | None = key(Number("", gt=-1, lt=0.5), "Poisson's ratio", default=None, example=0.3)
    rho: float | Profile | None = key(ProfileOf("kg/m^3", gt=0), "Density; needed for solvers dynamic and eigen, "
                                      "gravity and steady_rotation",
                            default=None,
                            example=7850)
    alpha: float | None = key(Number("1/K"), "Coefficient of thermal expansion, the same in all directions; needed for "
                              "load temperature", default=None, example=1.2e-5)
    damping: MaterialDamping | None = key(Record(MaterialDamping), "Material damping", default=None)
    yield_: float | None = key(Number("Pa", gt=0), "Yield stress of the fibres along the axis; shear stays elastic",
                               default=None, name="yield", example=2.5e8)
    hardening: LinearHardening | None = key(Record(LinearHardening), "Linear hardening beyond the yield stress "
                                            "(default: none)",
                                      default=None, example={"isotropic": 1e9, "kinematic": 0})
    stress_strain: StressStrain | None = key(Record(StressStrain), "Stress of the fibres along the axis as a curve, in "
                                             "place of yield and hardening; shear stays elastic", default=None)

    viscoelastic: tuple[MaxwellTerm, ...] | None = key(
        ListOf(Record(MaxwellTerm), "terms", 1), "Generalised Maxwell material: springs with dashpots in parallel with "
        "E, the long-time modulus; Poisson's ratio is constant", default=None, example=[{"modulus": 0.5, "time": 0.1}])

    law: str = key(Choice("linear", "neo_hooke"), "Stress-strain law; neo_hooke: mu/2 (I_C - 3 - 2 ln J) + "
                   "lambda/2 (ln J)^2 in plane stress, in formulation continuum", default="linear")

    @property
    def fibres(self) -> bool:
        """Whether its law acts on fibres: the axial stress is not just E times strain."""
        return self.yield_ is not None or self.stress_strain is not None

    @property
    def yields(self) -> bool:
        """Whether strain can be permanent: fibres do not unload along their loading curve."""
        return self.yield_ is not None or (self.stress_strain is not None and self.stress_strain.unloading == "elastic")

    @property
    def non_hookean(self) -> bool:
        """Whether its stress is not just a constant stiffness times strain; also true for hyperelastic materials."""
        return self.fibres or bool(self.viscoelastic) or self.law == "neo_hooke"

    def check(self) -> Iterator[Issue]:
        """Yield an issue for each law that excludes another, or lacks a key."""
        if self.hardening is not None and self.yield_ is None:
            yield Issue(("hardening",), "{}.hardening needs a yield stress", "yield, or stress_strain without "
                        "hardening")
        if self.stress_strain is not None and self.yield_ is not None:
            yield Issue(("yield",), "{}: yield and stress_strain exclude each other", "one of them")
        if self.viscoelastic and self.fibres:
            yield Issue(("viscoelastic",), "{}: a material that yields or follows a curve cannot be viscoelastic",
                        "viscoelastic, or "
                        "yield or stress_strain")
        if self.law == "neo_hooke" and (self.fibres or self.viscoelastic):
            yield Issue(("law",), "{}: law neo_hooke excludes yield, stress_strain and viscoelastic",
                        "law: linear, or neo_hooke alone")
        if self.law == "neo_hooke" and self.nu is not None and self.nu < 0.0:
            yield Issue(("nu",), f"{{}}.nu must be at least 0 for the law neo_hooke, got {self.nu:g}")
        if self.fibres and self.E is not None and not isinstance(self.E, float | int):
            yield Issue(("E",), "{}.E varies along the body, but the curve of the material does not", "a number")
        elif self.stress_strain is not None and self.stress_strain.points and isinstance(self.E, float | int):
            strain, stress = self.stress_strain.points[0]
            if strain and abs(stress / strain / self.E - 1.0) > FIRST_SLOPE:
                yield Issue(("E",), f"{{}}.E is {self.E:g}, but the curve begins with a slope of {stress / strain:g}",
                            "the same stiffness, or a first point at the end of the elastic part")
