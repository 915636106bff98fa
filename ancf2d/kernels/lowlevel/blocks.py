"""Elimination and solution with blocks of four rows and four columns of a symmetric band stored row by row.

A block starts at entry ``at`` of the band ``A`` (flat, rows of bw + 1 numbers); its row r starts r bw entries later.
The first ``outside`` + r columns of row r lie left of the band, and only ``count`` rows exist: the rest counts as zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from .jit import inlined
from .vectors import INDEX, LANES, Four, repeated, transposed

_i = types.intp


@inlined
def work_size(bw):  # type: ignore[no-untyped-def]
    """Return the size of a factorisation's work space: C (4, bw rounded up), then the factors of a block (4, 4)."""
    return 4 * ((bw + 3) // 4 * 4) + 16


@intrinsic
def size(_, x):  # type: ignore[no-untyped-def]
    """Return the size of a number, |re| + |im|."""
    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        is_complex = isinstance(signature.args[0], types.Complex)
        parts = [builder.extract_value(args[0], k) for k in range(2)] if is_complex else args
        bare = [builder.call(builder.module.declare_intrinsic("llvm.fabs", [v.type]), [v]) for v in parts]
        return bare[0] if len(bare) == 1 else builder.fadd(*bare)

    return types.float64(x), generate


@intrinsic
def inverse(_, x):  # type: ignore[no-untyped-def]
    """Return 1/x; complex x whose |x|^2 over- or underflows is first scaled by a power of two."""
    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        one = ir.Constant(ir.DoubleType(), 1.0)
        if not isinstance(signature.args[0], types.Complex):
            return builder.fdiv(one, args[0])
        parts = [builder.extract_value(args[0], k) for k in range(2)]
        square, plain = _over_square(builder, parts, one)
        out = [cgutils.alloca_once_value(builder, v) for v in plain]
        # the biased exponent is outside 100 to 1946 (of 2047)
        above = builder.sub(builder.bitcast(square, INDEX), ir.Constant(INDEX, 100 << 52))
        with cgutils.if_unlikely(builder, builder.icmp_unsigned(">", above, ir.Constant(INDEX, 1846 << 52))):
            scale = _scale(builder, parts)
            _, scaled = _over_square(builder, [builder.fmul(v, scale) for v in parts], scale)
            for place, v in zip(out, scaled, strict=True):
                builder.store(v, place)
        result = builder.insert_value(args[0], builder.load(out[0]), 0)
        return builder.insert_value(result, builder.load(out[1]), 1)

    return x(x), generate


def _over_square(builder: Any, parts: list[Any], factor: Any) -> tuple[Any, list[Any]]:
    """Return |x|^2, and real and imaginary part of factor/x."""
    real, imag = parts
    square = builder.fadd(builder.fmul(real, real), builder.fmul(imag, imag))
    over = builder.fdiv(factor, square)
    return square, [builder.fmul(real, over), builder.fmul(builder.fneg(imag), over)]


def _scale(builder: Any, parts: list[Any]) -> Any:
    """Return the power of two, a normal number, that scales the larger part to about one."""
    exponent, most = ir.Constant(INDEX, 2047 << 52), ir.Constant(INDEX, 2045 << 52)
    sizes = [builder.and_(builder.bitcast(v, INDEX), exponent) for v in parts]
    size = builder.select(builder.icmp_unsigned(">", *sizes), *sizes)
    size = builder.select(builder.icmp_unsigned("<", size, most), size, most)
    return builder.bitcast(builder.sub(ir.Constant(INDEX, 2046 << 52), size), ir.DoubleType())


class _Block:
    """Code generation for a block: addresses of its rows, loads and masks."""

    def __init__(self, context: Any, builder: Any, array_type: Any, array: Any, at: Any, bw: Any) -> None:
        self.builder, self.is_complex = builder, isinstance(array_type.dtype, types.Complex)
        self.start, self.bw = builder.gep(context.make_array(array_type)(context, builder, array).data, [at]), bw

    def row(self, r: Any) -> Any:
        return self.builder.gep(self.start, [self.builder.mul(self.bw, r)])

    def rows(self, count: Any) -> tuple[list[Any], list[Any]]:
        """Return pointers to the four rows (the last existing row instead of missing ones), and which rows exist."""
        b = self.builder
        there = [b.icmp_signed("<", ir.Constant(INDEX, r), count) for r in range(LANES)]
        last = b.sub(count, ir.Constant(INDEX, 1))
        return [self.row(b.select(t, ir.Constant(INDEX, r), last)) for r, t in enumerate(there)], there

    def inside(self, outside: Any, r: int) -> Any:
        """Return the mask of the columns of row r that lie in the band."""
        b = self.builder
        lanes = ir.Constant(ir.VectorType(INDEX, LANES), list(range(LANES)))
        return b.icmp_signed(">=", lanes, repeated(b, b.add(outside, ir.Constant(INDEX, r))))

    def load(self, pointer: Any) -> Four:
        return Four.load(self.builder, pointer, self.is_complex)

    def load_first(self, pointer: Any, count: int) -> Four:
        return Four.load_first(self.builder, pointer, count, self.is_complex)

    def zeros(self) -> Four:
        return Four.zeros(self.builder, self.is_complex)

    def spread(self, value: Any) -> Four:
        return Four.of(self.builder, value, self.is_complex)


def _data(context: Any, builder: Any, array_type: Any, array: Any, at: Any) -> Any:
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [at])


@intrinsic
def eliminate(_, A, at, bw, outside, count, C, stride, column, scale, row, over, below):  # type: ignore[no-untyped-def]
    """Replace a block below four pivots by its factors l = x/d; return whether any is nonzero.

    x = l d goes to C (4, stride) from ``column`` on, the factors also behind C; sizes |l x| are added to scale from
    ``row`` on. over : (4,) reciprocal pivots; below : L D below the pivots in the triangle, entries (1, 0), (2, 0),
    (2, 1), (3, 0), (3, 1), (3, 2).
    """
    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        A, at, bw, outside, count, C, stride, column, scale, row, over, below = args
        kinds = signature.args
        block = _Block(context, builder, kinds[0], A, at, bw)
        places, there = block.rows(count)
        old = [block.load(p) for p in places]
        masks = [block.inside(outside, r) for r in range(LANES)]
        x = transposed([v.where(mask, block.zeros()) for v, mask in zip(old, masks, strict=True)])
        inverse = [block.spread(v) for v in cgutils.unpack_tuple(builder, over, LANES)]
        under = iter([block.spread(v) for v in cgutils.unpack_tuple(builder, below, 6)])
        l: list[Four] = []
        total = found = None
        for q in range(LANES):
            for p in range(q):
                x[q] = x[q].less(l[p], next(under))
            l.append(x[q].times(inverse[q]))
            size, some = l[q].times(x[q]).sizes(), x[q].any()
            total, found = (size, some) if q == 0 else (builder.fadd(total, size), builder.or_(found, some))
            x[q].store(_data(context, builder, kinds[5], C,
                             builder.add(column, builder.mul(stride, ir.Constant(INDEX, q)))))
        factors = _data(context, builder, kinds[5], C, builder.mul(stride, ir.Constant(INDEX, LANES)))
        sizes = _data(context, builder, kinds[8], scale, row)
        for r, v in enumerate(transposed(l)):
            v.store(builder.gep(factors, [ir.Constant(INDEX, LANES * r)]))
            with builder.if_then(there[r], likely=True):
                v.where(masks[r], old[r]).store(places[r])
                size = builder.gep(sizes, [ir.Constant(INDEX, r)])
                more = builder.extract_element(total, ir.Constant(ir.IntType(32), r))
                builder.store(builder.fadd(builder.load(size), more), size)
        bits = builder.bitcast(found, ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    numbers = types.UniTuple(A.dtype, LANES), types.UniTuple(A.dtype, 6)
    return types.boolean(A, _i, _i, _i, _i, C, _i, _i, scale, _i, *numbers), generate


def _subtracting(diagonal: bool) -> Callable[..., Any]:
    @intrinsic
    def subtract_product(_, A, at, bw, count, C, stride, column):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
            A, at, bw, count, C, stride, column = args
            block = _Block(context, builder, signature.args[0], A, at, bw)
            factors = _data(context, builder, signature.args[4], C, builder.mul(stride, ir.Constant(INDEX, LANES)))
            columns = [block.load(_data(context, builder, signature.args[4], C,
                                        builder.add(column, builder.mul(stride, ir.Constant(INDEX, q)))))
                       for q in range(LANES)]
            for r in range(LANES):
                with builder.if_then(builder.icmp_signed("<", ir.Constant(INDEX, r), count), likely=True):
                    _subtract_row(block, r, factors, columns, diagonal)
            return context.get_dummy_value()

        return types.void(A, _i, _i, _i, C, _i, _i), generate

    return subtract_product


def _subtract_row(block: _Block, r: int, factors: Any, columns: list[Four], diagonal: bool) -> None:
    builder, place = block.builder, block.row(ir.Constant(INDEX, r))
    v = block.load_first(place, r + 1) if diagonal else block.load(place)
    for q in range(LANES):
        l = builder.gep(factors, [ir.Constant(INDEX, LANES * r + q)])
        if block.is_complex:
            l = builder.bitcast(l, ir.LiteralStructType([ir.DoubleType()] * 2).as_pointer())
        v = v.less(block.spread(builder.load(l)), columns[q])
    if diagonal:
        for lane in range(r + 1):
            v.put(builder.gep(place, [ir.Constant(INDEX, lane)]), lane)
    else:
        v.store(place)


# take(A, at, bw, count, C, stride, column): subtract l C from a block of A, with the factors l behind C and the columns
# of C (4, 4) from ``column`` on; take_diagonal changes only the lower half of a block on the diagonal
subtract_product, subtract_on_diagonal = _subtracting(False), _subtracting(True)


@intrinsic
def forward(_, A, at, bw, x, k, blocks):  # type: ignore[no-untyped-def]
    """Solve for x[k:k + 4], whose first pivot is at entry ``at``; subtract their terms from ``blocks`` blocks below."""
    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        A, at, bw, x, k, blocks = args
        own = _Block(context, builder, signature.args[0], A, at, bw)
        target = _data(context, builder, signature.args[3], x, k)
        v, solved = own.load(target), []
        for j, column in enumerate(transposed(_triangle(own))):
            solved.append(v.lane(j))
            # the last column is zero
            v = v.less(column, solved[j]) if j < LANES - 1 else v
        v.store(target)
        with cgutils.for_range(builder, blocks) as loop:
            rows, place = _below(context, builder, signature, args, loop.index)
            v = own.load(place)
            for column, number in zip(transposed(rows), solved, strict=True):
                v = v.less(column, number)
            v.store(place)
        return context.get_dummy_value()

    return types.void(A, _i, _i, x, _i, _i), generate


@intrinsic
def backward(_, A, at, bw, x, k, blocks):  # type: ignore[no-untyped-def]
    """Subtract the transposed terms of ``blocks`` blocks below from x[k:k + 4], the nearest last, and solve for it."""
    def generate(context, builder, signature, args):  # type: ignore[no-untyped-def]
        A, at, bw, x, k, blocks = args
        own = _Block(context, builder, signature.args[0], A, at, bw)
        target = _data(context, builder, signature.args[3], x, k)
        start = own.load(target)
        parts = [cgutils.alloca_once_value(builder, part) for part in start.parts]
        with cgutils.for_range(builder, blocks) as loop:
            back = builder.sub(builder.sub(blocks, ir.Constant(INDEX, 1)), loop.index)
            rows, place = _below(context, builder, signature, args, back)
            v = Four(builder, *(builder.load(part) for part in parts))
            numbers = _numbers(own, place)
            # in the order in which they were solved
            for r in reversed(range(LANES)):
                v = v.less(rows[r], numbers[r])
            for part, value in zip(parts, v.parts, strict=True):
                builder.store(value, part)
        v = Four(builder, *(builder.load(part) for part in parts))
        rows = _triangle(own)
        for r in range(LANES - 1, 0, -1):
            v = v.less(rows[r], v.lane(r))
        v.store(target)
        return context.get_dummy_value()

    return types.void(A, _i, _i, x, _i, _i), generate


def _triangle(block: _Block) -> list[Four]:
    """Return the rows of the strict lower triangle of a block."""
    masks = [ir.Constant(ir.VectorType(ir.IntType(1), LANES), [j < r for j in range(LANES)]) for r in range(LANES)]
    return [block.zeros()] + [block.load(block.row(ir.Constant(INDEX, r))).where(masks[r], block.zeros())
                              for r in range(1, LANES)]


def _below(context: Any, builder: Any, signature: Any, args: Any, number: Any) -> tuple[list[Four], Any]:
    """Return the rows of block ``number`` below four pivots, and a pointer to its part of x."""
    A, at, bw, x, k, _ = args
    below = builder.mul(builder.add(number, ir.Constant(INDEX, 1)), ir.Constant(INDEX, LANES))
    block = _Block(context, builder, signature.args[0], A, builder.add(at, builder.mul(below, bw)), bw)
    outside = builder.sub(below, bw)
    rows = [block.load(block.row(ir.Constant(INDEX, r))).where(block.inside(outside, r), block.zeros())
            for r in range(LANES)]
    return rows, _data(context, builder, signature.args[3], x, builder.add(k, below))


def _numbers(block: _Block, pointer: Any) -> list[Four]:
    """Return the four numbers at a pointer, each repeated in all lanes."""
    builder = block.builder
    if block.is_complex:
        pointer = builder.bitcast(pointer, ir.LiteralStructType([ir.DoubleType()] * 2).as_pointer())
    return [block.spread(builder.load(builder.gep(pointer, [ir.Constant(INDEX, r)]))) for r in range(LANES)]
