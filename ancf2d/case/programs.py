"""Assembles functions of a case, such as amplitudes, into programs of a stack machine (``jets``); evaluates them."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

from ..errors import ComputationError
from . import jets
from .syntax import Call, Chain, Choice, Comparison, Constant, Negative, Power, Quantity, Tree, Variable


class Assembler:
    """Writes programs of the stack machine.

    ``meaning`` maps the name of a quantity to its number in the machine, or to the expression that replaces it.
    """

    def __init__(self, meaning: Mapping[str, int | Tree] | None = None) -> None:
        self.meaning = meaning or {}
        self.code: list[int] = []
        self.arg: list[int] = []
        self.data: list[float] = []
        # height of the stack after each instruction
        self.heights: list[int] = []
        self.depth = self.height = 0
        # first instruction and first quantity of each function, and the end of the last one
        self.first, self.users = [0], [0]
        # quantities used by the functions one after another, and by the present one with their rows in the stack
        self.used: list[int] = []
        self.rows: dict[int, int] = {}

    def emit(self, op: int, grows: int, *numbers: float) -> int:
        """Append an instruction with its numbers and the growth of the stack; return its index."""
        self.code.append(op)
        self.arg.append(len(self.data))
        self.data += numbers
        self.height += grows
        self.depth = max(self.depth, self.height)
        self.heights.append(self.height)
        return len(self.code) - 1

    def end_function(self) -> None:
        """Close a function; the next instruction begins another one."""
        self.used += self.rows
        self.rows, self.height = {}, 0
        self.first.append(len(self.code))
        self.users.append(len(self.used))

    def assembled(self, rows: int) -> jets.Programs:
        """Return the programs of all closed functions, with a stack of as many rows."""
        import numpy as np

        first, users, code, arg, used = (np.array(numbers, dtype=np.int64) for numbers in (
            self.first, self.users, self.code, self.arg, self.used))
        return jets.Programs(first, code, arg, np.array(self.data, dtype=np.float64), np.array([-np.inf, np.inf]),
                             users, used, np.zeros((rows, max(self.depth, 1))))

    def set_targets(self, jumps: list[int]) -> None:
        """Make the jumps at these indices go to the next instruction."""
        for at in jumps:
            self.arg[at] = len(self.code)

    def tree(self, tree: Tree) -> None:
        """Append the instructions that put an expression on the stack."""
        match tree:
            case Constant(value):
                self.emit(jets.NUMBER, 1, value)
            case Variable():
                self.emit(jets.TIME, 1)
            case Quantity(name):
                meant = self.meaning.get(name, 0)
                if isinstance(meant, int):
                    self.emit(jets.QUANTITY, 1, meant, self.rows.setdefault(meant, 1 + len(self.rows)))
                else:
                    self.tree(meant)
            case Negative(operand):
                self.tree(operand)
                self.emit(jets.NEGATE, 0)
            case Power(base, Constant(2.0)):
                self.tree(base)
                self.emit(jets.SQUARE, 0)
            case Power(base, exponent):
                self.tree(base)
                self.tree(exponent)
                self.emit(jets.POWER, -1)
            case Chain(first, rest):
                self.tree(first)
                for op, operand in rest:
                    self.tree(operand)
                    self.emit(_BINARY[op], -1)
            case Call(name, argument):
                self.tree(argument)
                self.emit(_FUNCTIONS[name], 0)
            case Comparison(first, rest):
                self.comparison(first, rest)
            case Choice(condition, chosen, other):
                self.choice(condition, chosen, other)

    def comparison(self, first: Tree, rest: tuple[tuple[str, Tree], ...]) -> None:
        """Compare from left to right; the first comparison that fails jumps over the rest."""
        self.tree(first)
        failed = []
        for op, operand in rest[:-1]:
            self.tree(operand)
            self.emit(jets.KEEP, 1)
            self.emit(_COMPARE[op], -1)
            failed.append(self.emit(jets.UNLESS, -1))
        op, operand = rest[-1]
        self.tree(operand)
        self.emit(_COMPARE[op], -1)
        self.set_targets(failed)

    def choice(self, condition: Tree, chosen: Tree, other: Tree) -> None:
        """Evaluate one of two expressions."""
        self.tree(condition)
        otherwise = self.emit(jets.BRANCH, -1)
        self.tree(chosen)
        done = self.emit(jets.JUMP, -1)
        self.set_targets([otherwise])
        self.tree(other)
        self.set_targets([done])


_BINARY = {"+": jets.ADD, "-": jets.SUBTRACT, "*": jets.MULTIPLY, "/": jets.DIVIDE}
_COMPARE = {"<": jets.LESS, "<=": jets.LESS_EQUAL, ">": jets.GREATER, ">=": jets.GREATER_EQUAL, "==": jets.EQUAL,
            "!=": jets.UNEQUAL}
_FUNCTIONS = {"sin": jets.SIN, "cos": jets.COS, "exp": jets.EXP, "sqrt": jets.SQRT, "abs": jets.ABS}


class Function:
    """A function of one variable in a case: ``scale`` times the value that ``emit`` programs."""

    variable = "t"
    scale = 1.0
    # known places where it may not be smooth; whether it is a polynomial between them
    knots: tuple[float, ...] = ()
    polynomial = constant = False
    # its formula, which may switch; the functions that it consists of, whose breaks it shares
    tree: Tree | None = None
    parts: tuple[Function, ...] = ()

    @property
    def ungated(self) -> Function:
        """The function while it is active, if only the motion decides when that is; else the function itself."""
        return self

    def emit(self, out: Assembler) -> None:
        """Append the instructions that put the function on the stack, without its scale."""
        raise NotImplementedError

    def value(self, t: float) -> float:
        """Return the value at t. Raises ComputationError if there is none."""
        return self._finite(0, t)

    def rate(self, t: float) -> float:
        """Return the derivative at t, from the right at a corner. Raises ComputationError if there is none."""
        return self._finite(1, t)

    def jet(self, t: float) -> tuple[float, float, float]:
        """Return the value and two derivatives at t, nan where they do not exist."""
        return _run(self._program, t)

    @cached_property
    def _program(self) -> Assembler:
        out = Assembler()
        self.emit(out)
        out.emit(jets.SCALE, 0, self.scale, 0.0)
        return out

    def _finite(self, order: int, t: float) -> float:
        found = self.jet(t)[order]
        if math.isfinite(found):
            return found
        raise ComputationError(f"{self.described()} has no {('value', 'rate')[order]} at {self.variable} = {t:g}: "
                               f"{_trouble(self._program, t)}", at={self.variable: t},
                               advice="guard the expression with 'a if c else b'")

    def described(self) -> str:
        """Return the name of the function for messages."""
        return f"the {type(self).__name__.lower()}"

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names of the quantities of a motion that the value depends on."""
        return ()


def _run(program: Assembler, t: float, length: int | None = None, stack: Any = None) -> tuple[float, float, float]:
    """Return the result and two derivatives of a program, or of its first ``length`` instructions."""
    n = len(program.code) if length is None else length
    # the first instructions may end in a jump beyond them, which leaves the stack empty
    stack = defaultdict(float) if stack is None else stack
    made = jets.Programs((0, n), program.code, program.arg, program.data, None, (), (), stack)
    out: dict[Any, float] = {}
    try:
        jets.run(made, 0, float(t), out, 0)
    except (OverflowError, ZeroDivisionError, ValueError):
        import numpy as np

        # numpy's numbers are slower, but continue with infinity; except for its sine and its whole part
        try:
            with np.errstate(all="ignore"):
                jets.run(made._replace(data=np.array(program.data)), 0, np.float64(t), out, 0)
        except (OverflowError, ValueError):
            return math.nan, math.nan, math.nan
    return float(out[0, 0]), float(out[0, 1]), float(out[0, 2])


def _trouble(program: Assembler, t: float) -> str:
    """Return why a program has no value or rate at t, from its first instruction without a finite result."""
    for n, op in enumerate(program.code):
        stack: Any = defaultdict(float)
        if all(map(math.isfinite, _run(program, t, n + 1, stack)[:2])):
            continue
        top = program.heights[n] - 1
        if op == jets.DIVIDE:
            return "it divides by zero"
        if op == jets.EXP:
            return "it is too large"
        if op == jets.POWER:
            before: Any = defaultdict(float)
            _run(program, t, n, before)
            base, exponent = float(before[0, top]), float(before[0, top + 1])
            return "it is too large" if abs(base) > 1.0 and exponent > 0.0 else "a square root or a power is not real"
        return "a square root or a power is not real" if op == jets.SQRT else "it is too large"
    return "it is too large"


def programs(functions: Iterable[tuple[Function | None, float, float]], clocks: Collection[int] = ()) -> jets.Programs:
    """Return programs for kernels that compute offset + factor * function(t) for each (function, factor, offset).

    None stands for the function 1; the list may be empty. Functions in ``clocks`` have t instead of their rate.
    """
    out = Assembler()
    for k, (function, factor, offset) in enumerate(functions):
        if function is None:
            out.emit(jets.NUMBER, 1, 1.0)
        else:
            function.emit(out)
        out.emit(jets.SCALE, 0, factor * (1.0 if function is None else function.scale), offset)
        if k in clocks:
            out.emit(jets.CLOCK, 0)
        out.end_function()
    return out.assembled(3)


def are_constant(programs: jets.Programs) -> bool:
    """Return whether all functions are constant in time: only scaled numbers."""
    import numpy as np

    return bool(np.isin(programs.code, (jets.NUMBER, jets.SCALE)).all())


def state_programs(functions: Sequence[tuple[Function | Tree, float]], meaning: Mapping[str, int | Tree], count: int
                   ) -> jets.Programs:
    """Return programs with ``count`` quantities for each (function or tree, factor), for ``jets.run_with_gradient``.

    ``meaning`` is that of ``Assembler``.
    """
    out = Assembler(meaning)
    for function, factor in functions:
        if isinstance(function, Function):
            function.emit(out)
            factor *= function.scale
        else:
            out.tree(function)
        out.emit(jets.SCALE, 0, factor, 0.0)
        out.end_function()
    return out.assembled(1 + count)


def value_at(program: jets.Programs, k: int, t: float, values: Sequence[float]) -> tuple[float, list[float]]:
    """Return function k of ``state_programs`` at t, and its derivatives by the quantities; nan if it has no value."""
    import numpy as np

    out = np.zeros(1 + len(values))
    with np.errstate(all="ignore"):
        jets.run_with_gradient(program, k, np.float64(t), np.asarray(values, dtype=float), out)
    return float(out[0]), out[1:].tolist()


def switches(program: jets.Programs, count: int) -> bool:
    """Return whether one of the first ``count`` functions may jump or have a kink: it compares, or uses abs."""
    code = program.code[:program.first[count]].tolist()
    return bool({*range(jets.LESS, jets.UNEQUAL + 1), jets.ABS} & set(code))
