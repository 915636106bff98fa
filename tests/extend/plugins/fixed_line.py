"""Reut's load: a force along a fixed vertical line, divided between the ends of a plate by the lever rule."""

from ancf2d.extend import AMPLITUDE, AMPLITUDE_DOC, NAME, POINT, Number, key, load, record


def force(x, y, par):
    """Return the force and its derivatives: P if the line is at this end, 0 if it is at the other end."""
    P, axis, width = par[0], par[1], par[2]
    return 0.0, P * (1.0 + (x - axis) / width), 0.0, 0.0, P / width, 0.0


@load(force, potential=False)
@record
class FixedLine:
    """The part of the force on one end of a plate."""

    tag = "fixed_line"
    at: object = key(POINT, "End of the plate", example="plate@0")
    value: float = key(Number("N"), "Total force, upwards")
    axis: float = key(Number("m"), "x of the line")
    width: float = key(Number("m"), "x of the other end minus x of this end")
    amplitude: object = key(AMPLITUDE, AMPLITUDE_DOC, default=None)
    name: str | None = key(NAME, "Name", default=None)

    def constants(self):
        """Return the constants of the law."""
        return [self.value, self.axis, self.width]
