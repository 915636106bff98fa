"""Functions of a case as programs of a small stack machine that computes values together with derivatives.

``run`` computes two derivatives by time, ``run_with_gradient`` the derivatives by quantities of the running motion. The
code runs as plain Python in the case and is compiled for the kernels; the types of the arrays are the same for all
functions, so kernels are compiled once.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

(NUMBER, TIME, NEGATE, ADD, SUBTRACT, MULTIPLY, DIVIDE, POWER, SIN, COS, EXP, SQRT, SQUARE, ABS,
 LESS, LESS_EQUAL, GREATER, GREATER_EQUAL, EQUAL, UNEQUAL, KEEP, UNLESS, JUMP, BRANCH,
 RAMP, TABLE, SMOOTH_TABLE, SINE, SCALE, QUANTITY, CLOCK) = range(31)


class Programs(NamedTuple):
    """Programs of many functions: function k has the instructions first[k] to first[k + 1] - 1.

    ``code`` (n,) has the operations, ``arg`` (n,) the target of a jump or the index in ``data`` where the operation's
    numbers begin. ``window`` (2,) has the first and last time of evaluation; other times are clamped to it, so that a
    step up to a break does not see what follows. Function k depends on the quantities used[users[k]] to used[users[k +
    1] - 1]. ``stack`` is work space: (3, depth), with quantities (1 + quantities, depth). Jump targets count from the
    beginning of ``code``. JUMP always jumps; BRANCH pops the top and jumps if it is 0; UNLESS does so too, and when it
    jumps sets the new top to 0. KEEP inserts a copy of the top below the two topmost, for a chain of comparisons.
    QUANTITY pushes a quantity, whose numbers are its own and its row in the stack; CLOCK sets the first derivative of
    the top to the time.
    """

    first: Any
    code: Any
    arg: Any
    data: Any
    window: Any
    users: Any
    used: Any
    stack: Any


def compare(op: int, a: float, b: float) -> float:
    """Return 1 if the comparison of a with b holds, else 0; nan if one of them is nan."""
    if math.isnan(a) or math.isnan(b):
        return math.nan
    if op == LESS:
        holds = a < b
    elif op == LESS_EQUAL:
        holds = a <= b
    elif op == GREATER:
        holds = a > b
    elif op == GREATER_EQUAL:
        holds = a >= b
    elif op == EQUAL:
        holds = a == b
    else:
        holds = a != b
    return 1.0 if holds else 0.0


def power_jet(a, ad, add, b, bd, bdd):  # type: ignore[no-untyped-def]
    """Return a^b with its two derivatives, nan where they are not real or not finite.

    Zero rates contribute nothing, so a base under a constant whole exponent may be negative or zero.
    """
    if math.isnan(a) or math.isnan(b) or (a < 0.0 and b != math.floor(b)) or (a == 0.0 and b < 0.0):
        return math.nan, math.nan, math.nan
    f = a**b
    if math.isinf(f):
        return math.nan, math.nan, math.nan
    moving = bd != 0.0 or bdd != 0.0
    if a > 0.0 and moving:
        L = math.log(a)
        g, gg = bd * L + b * ad / a, bdd * L + 2.0 * bd * ad / a + b * (add / a - (ad / a) * (ad / a))
        return f, f * g, f * (gg + g * g)
    fd, fdd = 0.0, 0.0
    if bd != 0.0:
        fd = math.nan
    elif ad != 0.0 and b != 0.0:
        fd = b * ad * (a ** (b - 1.0) if a != 0.0 or b >= 1.0 else math.nan)
    if moving:
        return f, fd, math.nan
    if add != 0.0 and b != 0.0:
        fdd += b * add * (a ** (b - 1.0) if a != 0.0 or b >= 1.0 else math.nan)
    if ad != 0.0 and b != 0.0 and b != 1.0:
        fdd += b * (b - 1.0) * ad * ad * (a ** (b - 2.0) if a != 0.0 or b >= 2.0 else math.nan)
    return f, fd, fdd


def function_jet(op, a, ad, add):  # type: ignore[no-untyped-def]
    """Return sin, cos, exp, sqrt, the square or abs of a jet, nan where it has no value."""
    if math.isnan(a) or math.isinf(a) or (op == SQUARE and math.isinf(a * a)):
        return math.nan, math.nan, math.nan
    if op == SQUARE:
        return a * a, 2.0 * a * ad, 2.0 * (ad * ad + a * add)
    if op in (SIN, COS):
        s, c = math.sin(a), math.cos(a)
        if op == SIN:
            return s, c * ad, c * add - s * ad * ad
        return c, -s * ad, -s * add - c * ad * ad
    if op == EXP:
        f = math.exp(a) if a <= 709.782712893384 else math.nan
        return f, f * ad, f * (add + ad * ad)
    if op == ABS:
        # where it passes through zero, the sign just after
        sign = -1.0 if a < 0.0 or (a == 0.0 and (ad < 0.0 or (ad == 0.0 and add < 0.0))) else 1.0
        return abs(a), sign * ad, sign * add
    if a < 0.0:
        return math.nan, math.nan, math.nan
    f = math.sqrt(a)
    if ad == 0.0 and add == 0.0:
        return f, 0.0, 0.0
    if f == 0.0:
        return f, 0.0 if ad == 0.0 else math.nan, math.nan
    return f, 0.5 * ad / f, 0.5 * add / f - 0.25 * (ad / f) * (ad / a)


def table_jet(data, p, smooth, t):  # type: ignore[no-untyped-def]
    """Return a table and its derivatives at t, from the right at its points.

    ``data[p]`` is the number n of points, followed by n times, n values and n slopes.
    """
    n = int(data[p])
    times, values, slopes = p + 1, p + 1 + n, p + 1 + 2 * n
    if t < data[times]:
        return data[values], 0.0, 0.0
    if t >= data[times + n - 1]:
        return data[values + n - 1], 0.0, 0.0
    low, high = 0, n - 1
    while high - low > 1:
        middle = (low + high) // 2
        if data[times + middle] > t:
            high = middle
        else:
            low = middle
    h = data[times + low + 1] - data[times + low]
    a, change = data[values + low], data[values + low + 1] - data[values + low]
    x = (t - data[times + low]) / h
    if not smooth:
        return a + change * x, change / h, 0.0
    m0, m1 = h * data[slopes + low], h * data[slopes + low + 1]
    c2, c3 = 3.0 * change - 2.0 * m0 - m1, m0 + m1 - 2.0 * change
    return a + x * (m0 + x * (c2 + x * c3)), (m0 + x * (2.0 * c2 + 3.0 * x * c3)) / h, (2.0 * c2 + 6.0 * x * c3) / h**2


def time_jet(op, data, p, t):  # type: ignore[no-untyped-def]
    """Return a number, t, a ramp, a table or a sine at t with two derivatives; its numbers begin at ``data[p]``."""
    if op == NUMBER:
        return data[p], 0.0, 0.0
    if op == TIME:
        return t, 1.0, 0.0
    if op == RAMP:
        width = data[p + 1] - data[p]
        rate = 1.0 / width if data[p] <= t < data[p + 1] else 0.0
        return min(1.0, max(0.0, (t - data[p]) / width)), rate, 0.0
    if op == SINE:
        omega = data[p]
        s, c = math.sin(omega * t + data[p + 1]), math.cos(omega * t + data[p + 1])
        return s, omega * c, -omega * omega * s
    return table_jet(data, p, op == SMOOTH_TABLE, t)


def binary_jet(op, a, ad, add, b, bd, bdd):  # type: ignore[no-untyped-def]
    """Return a binary operation on two jets; comparisons have zero derivatives."""
    if op == ADD:
        return a + b, ad + bd, add + bdd
    if op == SUBTRACT:
        return a - b, ad - bd, add - bdd
    if op == MULTIPLY:
        return a * b, ad * b + a * bd, add * b + 2.0 * ad * bd + a * bdd
    if op == DIVIDE:
        if b == 0.0:
            return math.nan, math.nan, math.nan
        f = a / b
        fd = (ad - f * bd) / b
        return f, fd, (add - 2.0 * fd * bd - f * bdd) / b
    if op == POWER:
        return power_jet(a, ad, add, b, bd, bdd)
    return compare(op, a, b), 0.0, 0.0


def steer(op, p, at, end, top, stack, rows):  # type: ignore[no-untyped-def]
    """Execute a jump or KEEP on a stack with ``rows`` rows; return the next instruction and the index of the top.

    A nan condition ends the program and stays on the stack as its result.
    """
    if op == JUMP:
        return p, top
    if op == KEEP:
        top += 1
        for i in range(rows):
            stack[i, top] = stack[i, top - 1]
            stack[i, top - 1] = stack[i, top - 2]
            stack[i, top - 2] = stack[i, top]
        return at, top
    if math.isnan(stack[0, top]):
        return end, top
    holds = stack[0, top] != 0.0
    top -= 1
    if not holds and op == UNLESS:
        for i in range(rows):
            stack[i, top] = 0.0
    return (at if holds else p), top


def run(programs, k, t, out, row):  # type: ignore[no-untyped-def]
    """Fill out[row] (3,) with function k and its two derivatives at t, nan where they are not finite."""
    code, arg, data, stack = programs.code, programs.arg, programs.data, programs.stack
    at, top, end = programs.first[k], -1, programs.first[k + 1]
    while at < end:
        op, p = code[at], arg[at]
        at += 1
        if KEEP <= op <= BRANCH:
            at, top = steer(op, p, at, end, top, stack, 3)
        elif op == SCALE:
            stack[0, top] = data[p + 1] + data[p] * stack[0, top]
            stack[1, top] *= data[p]
            stack[2, top] *= data[p]
        elif op == NEGATE:
            for i in range(3):
                stack[i, top] = -stack[i, top]
        elif op == CLOCK:
            stack[1, top], stack[2, top] = t, 0.0
        elif op == QUANTITY:
            # not a function of time alone
            top += 1
            stack[0, top] = stack[1, top] = stack[2, top] = math.nan
        elif SIN <= op <= ABS:
            stack[0, top], stack[1, top], stack[2, top] = function_jet(op, stack[0, top], stack[1, top], stack[2, top])
        elif op >= RAMP or op <= TIME:
            top += 1
            stack[0, top], stack[1, top], stack[2, top] = time_jet(op, data, p, t)
        else:
            top -= 1
            stack[0, top], stack[1, top], stack[2, top] = binary_jet(
                op, stack[0, top], stack[1, top], stack[2, top],
                stack[0, top + 1], stack[1, top + 1], stack[2, top + 1])
    for i in range(3):
        good = math.isfinite(stack[0, top]) and math.isfinite(stack[i, top])
        out[row, i] = stack[i, top] if good else math.nan


def combine(op, stack, top, rows):  # type: ignore[no-untyped-def]
    """Replace the two topmost by the result of a binary operation, with derivatives in the rows from 1."""
    a, b = stack[0, top], stack[0, top + 1]
    if op == MULTIPLY:
        f, by_a, by_b = a * b, b, a
    elif op in (ADD, SUBTRACT):
        by_a, by_b = 1.0, 1.0 if op == ADD else -1.0
        f = a + by_b * b
    else:
        f, by_a, _ = binary_jet(op, a, 1.0, 0.0, b, 0.0, 0.0)
        by_b, varies = 0.0, False
        for i in range(1, rows):
            varies |= stack[i, top + 1] != 0.0
        if varies:
            by_b = binary_jet(op, a, 0.0, 0.0, b, 1.0, 0.0)[1]
    for i in range(1, rows):
        # zero derivatives contribute nothing, even where the operation has no derivative
        one = by_a * stack[i, top] if stack[i, top] != 0.0 else 0.0
        stack[i, top] = one + by_b * stack[i, top + 1] if stack[i, top + 1] != 0.0 else one
    stack[0, top] = f


def run_with_gradient(programs, k, t, values, out):  # type: ignore[no-untyped-def]
    """Fill out (1 + n,) with function k at t and n values of quantities, and its derivatives by these.

    A value that is not finite is nan; a derivative that is not finite is 0.
    """
    code, arg, data, stack = programs.code, programs.arg, programs.data, programs.stack
    at, top, end = programs.first[k], -1, programs.first[k + 1]
    first = programs.users[k]
    rows = 1 + programs.users[k + 1] - first
    while at < end:
        op, p = code[at], arg[at]
        at += 1
        if KEEP <= op <= BRANCH:
            at, top = steer(op, p, at, end, top, stack, rows)
        elif op in (SCALE, NEGATE):
            factor = data[p] if op == SCALE else -1.0
            for i in range(rows):
                stack[i, top] *= factor
            stack[0, top] += data[p + 1] if op == SCALE else 0.0
        elif SIN <= op <= ABS:
            value, slope, _ = function_jet(op, stack[0, top], 1.0, 0.0)
            for i in range(1, rows):
                stack[i, top] = slope * stack[i, top] if stack[i, top] != 0.0 else 0.0
            stack[0, top] = value
        elif op == QUANTITY:
            top += 1
            for i in range(rows):
                stack[i, top] = 0.0
            stack[0, top], stack[int(data[p + 1]), top] = values[int(data[p])], 1.0
        elif op >= RAMP or op <= TIME:
            top += 1
            for i in range(rows):
                stack[i, top] = 0.0
            stack[0, top] = time_jet(op, data, p, t)[0]
        else:
            top -= 1
            combine(op, stack, top, rows)
    out[0] = stack[0, top] if math.isfinite(stack[0, top]) else math.nan
    for i in range(1, 1 + len(values)):
        out[i] = 0.0
    for i in range(1, rows):
        out[1 + programs.used[first + i - 1]] = stack[i, top] if math.isfinite(stack[i, top]) else 0.0
