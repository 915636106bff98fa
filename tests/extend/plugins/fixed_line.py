"""Reut's load: a force along a fixed vertical line, shared by the ends of a plate as the line divides it."""

from ancf2d.extend import AMPLITUDE, AMPLITUDE_DOC, NAME, POINT, Number, key, load, record


def force(x, y, par):
    """Return the force and its derivatives by x and y: P with the line at this end, none with it at the other."""
    P, axis, width = par[0], par[1], par[2]
    return 0.0, P * (1.0 + (x - axis) / width), 0.0, 0.0, P / width, 0.0


@load(force, potential=False)
@record
class FixedLine:
    """The share of one end of a plate."""

    tag = "fixed_line"
    at: object = key(POINT, "End of the plate", example="plate@0")
    value: float = key(Number("N"), "The whole force, upwards")
    axis: float = key(Number("m"), "x of the line")
    width: float = key(Number("m"), "x of the other end less that of this one")
    amplitude: object = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def constants(self):
        """Return the constants of the law."""
        return [self.value, self.axis, self.width]
