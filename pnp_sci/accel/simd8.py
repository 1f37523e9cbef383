"""Eight float32 in a row as one vector, where LLVM makes none by itself: rows that lie anywhere, squares, products.

Numba's files of compiled kernels do not notice a change in here: delete ``__pycache__/*.nb?`` after one.
"""

from typing import Any

from llvmlite import ir
from numba import extending, types
from numba.core.cgutils import alloca_once_value, for_range

intrinsic: Any = extending.intrinsic  # what it makes of a function takes all but the first argument
EIGHT, ROW = range(8), ir.VectorType(ir.FloatType(), 8)
LINES = 4  # of a product: its eight or twelve sums, and what they are made of, stay in registers


def _value(context, builder, kind, array, at):
    """Where a value of a flat array is."""
    assert (kind.dtype, kind.ndim, kind.layout) == (types.float32, 1, "C"), kind
    return builder.gep(context.make_array(kind)(context, builder, array).data, [at])


def _place(*where):
    """Where the row of an array begins that has its first value there."""
    return where[1].bitcast(_value(*where), ROW.as_pointer())


def _load(builder, place):
    row = builder.load(place)
    row.align = 4
    return row


def _store(builder, row, place):
    builder.store(row, place).align = 4


@intrinsic
def copy_row(typing, v, at, out, to):
    """out[to : to + 8] <- v[at : at + 8]; bounds are not checked."""

    def generate(context, builder, signature, arguments):
        v, at, out, to = arguments
        row = _load(builder, _place(context, builder, signature.args[0], v, at))
        _store(builder, row, _place(context, builder, signature.args[2], out, to))
        return context.get_dummy_value()

    return types.void(v, types.intp, out, types.intp), generate


@intrinsic
def add_row(typing, v, at, out, to):
    """out[to : to + 8] += v[at : at + 8]; bounds are not checked."""

    def generate(context, builder, signature, arguments):
        v, at, out, to = arguments
        row, place = (_place(context, builder, signature.args[n], a, i) for n, a, i in ((0, v, at), (2, out, to)))
        _store(builder, builder.fadd(_load(builder, row), _load(builder, place)), place)
        return context.get_dummy_value()

    return types.void(v, types.intp, out, types.intp), generate


@intrinsic
def transpose(typing, v, at):
    """v[at : at + 64], a matrix of eight rows of eight, <- its transpose; bounds are not checked."""

    def generate(context, builder, signature, arguments):
        v, at = arguments
        first = _place(context, builder, signature.args[0], v, at)
        places = [builder.gep(first, [ir.Constant(ir.IntType(32), i)]) for i in EIGHT]
        rows = [_load(builder, place) for place in places]
        for half in (4, 2, 1):  # of squares of twice as many, those above and below the diagonal change places
            for i in (i for i in EIGHT if not i & half):
                above, below = rows[i], rows[i + half]
                left = [8 + j - half if j & half else j for j in EIGHT]
                right = [8 + j if j & half else j + half for j in EIGHT]
                rows[i], rows[i + half] = (
                    builder.shuffle_vector(above, below, ir.Constant(ir.VectorType(ir.IntType(32), 8), order))
                    for order in (left, right)
                )
        for row, place in zip(rows, places):
            _store(builder, row, place)
        return context.get_dummy_value()

    return types.void(v, types.intp), generate


def _product(columns: int) -> Any:
    """A product of matrices: four lines of one times so many columns of the other, a multiple of eight."""

    def multiply(typing, v, at, depth, u, of, width, out, to):
        def generate(context, builder, signature, arguments):
            v, at, depth, u, of, width, out, to = arguments
            number = [ir.Constant(at.type, n) for n in range(max(LINES, columns))]
            parts = range(0, columns, 8)

            def where(n, array, begin, line, column):
                first = builder.add(builder.add(begin, line), column)
                return context, builder, signature.args[n], array, first

            sums = {
                (i, k): alloca_once_value(builder, ir.Constant(ROW, [0.0] * 8)) for i in range(LINES) for k in parts
            }
            everywhere = ir.Constant(ir.VectorType(ir.IntType(32), 8), [0] * 8)
            with for_range(builder, depth) as loop:
                below = builder.mul(loop.index, width)
                rows = {k: _load(builder, _place(*where(3, u, of, below, number[k]))) for k in parts}
                for i in range(LINES):
                    value = builder.load(_value(*where(0, v, at, builder.mul(depth, number[i]), loop.index)))
                    factor = builder.insert_element(ir.Constant(ROW, ir.Undefined), value, number[0])
                    factor = builder.shuffle_vector(factor, factor, everywhere)
                    for k in parts:
                        term = builder.fmul(factor, rows[k], flags=["contract"])
                        total = builder.fadd(builder.load(sums[i, k]), term, flags=["contract"])
                        builder.store(total, sums[i, k])
            for i, k in sums:
                there = _place(*where(6, out, to, builder.mul(width, number[i]), number[k]))
                _store(builder, builder.load(sums[i, k]), there)
            return context.get_dummy_value()

        whole = types.intp
        return types.void(v, whole, whole, u, whole, whole, out, whole), generate

    return intrinsic(multiply)


# out[to + width i : + columns] <- the sum of v[at + depth i + c] u[of + width c : + columns] over c < depth, for i < 4:
# matrices are v, (.., depth), and u, (depth, width); bounds are not checked
multiply_16, multiply_24 = _product(16), _product(24)
