"""Vectors of four real or complex numbers for code generation with llvmlite."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

DOUBLE, INDEX = ir.DoubleType(), ir.IntType(64)
LANES = 4
_VECTOR = ir.VectorType(DOUBLE, LANES)
_FUSED = ("contract",)


def _order(*lanes: int) -> ir.Constant:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))


def repeated(builder: Any, value: Any) -> Any:
    """Return a vector of one value in all lanes."""
    empty = ir.Constant(ir.VectorType(value.type, LANES), ir.Undefined)
    one = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, _order(*[0] * LANES))


class Four:
    """Four numbers in ``parts``: a vector of real parts and, if complex, one of imaginary parts."""

    def __init__(self, builder: Any, *parts: Any) -> None:
        self.builder, self.parts = builder, parts

    @classmethod
    def zeros(cls, builder: Any, is_complex: bool) -> Four:
        """Return four zeros."""
        return cls(builder, *[ir.Constant(_VECTOR, [0.0] * LANES)] * (1 + is_complex))

    @classmethod
    def of(cls, builder: Any, value: Any, is_complex: bool) -> Four:
        """Return a number in numba's representation, repeated in all lanes."""
        parts = [builder.extract_value(value, k) for k in range(2)] if is_complex else [value]
        return cls(builder, *(repeated(builder, x) for x in parts))

    @classmethod
    def load(cls, builder: Any, pointer: Any, is_complex: bool) -> Four:
        """Return four successive numbers at a pointer."""
        kind = ir.VectorType(DOUBLE, LANES * (1 + is_complex))
        v = builder.load(builder.bitcast(pointer, kind.as_pointer()), align=8)
        if not is_complex:
            return cls(builder, v)
        return cls(builder, *(builder.shuffle_vector(v, v, _order(*range(k, 2 * LANES, 2))) for k in range(2)))

    @classmethod
    def load_first(cls, builder: Any, pointer: Any, count: int, is_complex: bool) -> Four:
        """Return the first ``count`` numbers at a pointer without reading beyond them, where memory may end.

        Numbers before the pointer are read instead.
        """
        back = builder.gep(pointer, [ir.Constant(INDEX, count - LANES)])
        lanes = _order(*range(LANES - count, LANES), *[0] * (LANES - count))
        return cls(builder, *(builder.shuffle_vector(x, x, lanes)
                              for x in cls.load(builder, back, is_complex).parts))

    def store(self, pointer: Any) -> None:
        """Store the four numbers one after another."""
        v, b = self.parts[0], self.builder
        if len(self.parts) == 2:
            v = b.shuffle_vector(*self.parts, _order(*(j for i in range(LANES) for j in (i, i + LANES))))
        b.store(v, b.bitcast(pointer, v.type.as_pointer()), align=8)

    def lane(self, k: int) -> Four:
        """Return the number of lane k, repeated in all lanes."""
        return Four(self.builder, *(self.builder.shuffle_vector(x, x, _order(*[k] * LANES)) for x in self.parts))

    def put(self, pointer: Any, lane: int) -> None:
        """Store the number of one lane."""
        b = self.builder
        for k, x in enumerate(self.parts):
            place = b.gep(b.bitcast(pointer, DOUBLE.as_pointer()), [ir.Constant(INDEX, k)])
            b.store(b.extract_element(x, ir.Constant(ir.IntType(32), lane)), place)

    def times(self, other: Four) -> Four:
        """Return the products with other numbers, lane by lane."""
        b, x, y = self.builder, self.parts, other.parts
        if len(x) == 1:
            return Four(b, b.fmul(x[0], y[0], flags=_FUSED))
        real = self._less(b.fmul(x[0], y[0], flags=_FUSED), x[1], y[1])
        return Four(b, real, self._more(b.fmul(x[0], y[1], flags=_FUSED), x[1], y[0]))

    def less(self, x: Four, y: Four) -> Four:
        """Return self - x * y, lane by lane."""
        s, p, q = self.parts, x.parts, y.parts
        if len(s) == 1:
            return Four(self.builder, self._less(s[0], p[0], q[0]))
        real = self._more(self._less(s[0], p[0], q[0]), p[1], q[1])
        return Four(self.builder, real, self._less(self._less(s[1], p[0], q[1]), p[1], q[0]))

    def _more(self, s: Any, x: Any, y: Any) -> Any:
        return self.builder.fadd(s, self.builder.fmul(x, y, flags=_FUSED), flags=_FUSED)

    def _less(self, s: Any, x: Any, y: Any) -> Any:
        return self.builder.fsub(s, self.builder.fmul(x, y, flags=_FUSED), flags=_FUSED)

    def where(self, mask: Any, other: Four) -> Four:
        """Return these numbers where the mask is set, and ``other`` elsewhere."""
        return Four(self.builder, *(self.builder.select(mask, x, y)
                                    for x, y in zip(self.parts, other.parts, strict=True)))

    def sizes(self) -> Any:
        """Return the sizes of the numbers, |re| + |im|."""
        b, bits = self.builder, ir.VectorType(ir.IntType(64), LANES)
        bare = [b.bitcast(b.and_(b.bitcast(x, bits), ir.Constant(bits, [2**63 - 1] * LANES)), x.type)
                for x in self.parts]
        return bare[0] if len(bare) == 1 else b.fadd(*bare)

    def any(self) -> Any:
        """Return a mask of the lanes whose number is nonzero."""
        b = self.builder
        found = [b.fcmp_unordered("!=", x, ir.Constant(_VECTOR, [0.0] * LANES)) for x in self.parts]
        return found[0] if len(found) == 1 else b.or_(*found)


def transposed(rows: list[Four]) -> list[Four]:
    """Return the four columns of four rows."""
    b = rows[0].builder

    def columns(v: list[Any]) -> list[Any]:
        even, odd = ([b.shuffle_vector(v[i], v[i + 1], _order(k, k + 4, k + 2, k + 6)) for i in (0, 2)] for k in (0, 1))
        return [b.shuffle_vector(*pair, _order(k, k + 1, k + 4, k + 5)) for k in (0, 2) for pair in (even, odd)]

    return [Four(b, *parts) for parts in zip(*(columns([r.parts[k] for r in rows]) for k in range(len(rows[0].parts))),
                                             strict=True)]
