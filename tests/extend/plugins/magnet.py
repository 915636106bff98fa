"""A magnet that pulls a point: strength r/(r^2 + reach^2)^(3/2) at the distance r."""

from ancf2d.extend import AMPLITUDE, AMPLITUDE_DOC, NAME, POINT, Number, Vector, helper, key, load, record


@helper
def pull(x, y, px, py, q, d):
    """Return the force at (x, y) of a magnet at (px, py), and 1/(r^2 + d^2)."""
    s = 1.0 / ((px - x) ** 2 + (py - y) ** 2 + d * d)
    return q * (px - x) * s**1.5, q * (py - y) * s**1.5, s


def force(x, y, par):
    """Return the force and its derivatives with respect to x and y."""
    px, py, q, d = par[0], par[1], par[2], par[3]
    fx, fy, s = pull(x, y, px, py, q, d)
    xy = 3.0 * fx * (py - y) * s
    return fx, fy, -q * s**1.5 + 3.0 * fx * (px - x) * s, xy, xy, -q * s**1.5 + 3.0 * fy * (py - y) * s


@load(force, potential=True)
@record
class Magnet:
    """A magnet that pulls a point."""

    tag = "magnet"
    at: object = key(POINT, "Point on which it acts", example="beam@1")
    pole: tuple = key(Vector(Number("m"), "x, y"), "Position of the magnet", example=[1, 0])
    strength: float = key(Number("N m^2"), "Strength")
    reach: float = key(Number("m", gt=0), "Distance below which the force no longer grows")
    amplitude: object = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def constants(self):
        """Return the constants of the law."""
        return [*self.pole, self.strength, self.reach]
