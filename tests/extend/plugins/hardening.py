"""A hardening spring: N = k u + k3 u^3."""

from ancf2d.extend import ENDS, NAME, Number, key, record, spring


def force(u, rate, par):
    """Return energy, force, and its derivatives with respect to elongation and rate."""
    k, k3 = par[0], par[1]
    return k * u**2 / 2 + k3 * u**4 / 4, k * u + k3 * u**3, k + 3 * k3 * u**2, 0.0


@spring(force)
@record
class Hardening:
    """A spring between two points that hardens with the cube of its elongation."""

    tag = "hardening"
    between: tuple = key(ENDS, "The two ends", example=["a@1", [0, 1]])
    stiffness: float = key(Number("N/m", ge=0), "Stiffness of small elongations")
    cubic: float = key(Number("N/m^3", ge=0), "Factor of the cube of the elongation")
    name: str | None = key(NAME, "Name", default=None)

    def constants(self):
        """Return the constants of the law."""
        return [self.stiffness, self.cubic]
