"""8-lane SIMD intrinsics for float32, for loops that LLVM does not vectorise: rows, transposes, matrix products.

Numba's disk cache does not detect changes in this file: delete ``__pycache__/*.nb?`` after a change.
"""

from typing import Any

from llvmlite import ir
from numba import extending, types
from numba.core.cgutils import alloca_once_value, for_range

intrinsic: Any = extending.intrinsic  # the intrinsic has all arguments of the function except the first
EIGHT, ROW = range(8), ir.VectorType(ir.FloatType(), 8)
LINES = 4  # rows of a product, so that its sums and operands fit into registers


def _value(context, builder, kind, array, at):
    """Pointer to the value at index `at` of a flat array."""
    assert (kind.dtype, kind.ndim, kind.layout) == (types.float32, 1, "C"), kind
    return builder.gep(context.make_array(kind)(context, builder, array).data, [at])


def _place(*where):
    """Pointer to the row of eight values of which the first is given; arguments as for `_value`."""
    return where[1].bitcast(_value(*where), ROW.as_pointer())


def _load(builder, place):
    row = builder.load(place)
    row.align = 4
    return row


def _store(builder, row, place):
    builder.store(row, place).align = 4


@intrinsic
def copy_row(typing, v, at, out, to):
    """out[to : to + 8] <- v[at : at + 8], without bounds checks."""

    def generate(context, builder, signature, arguments):
        v, at, out, to = arguments
        row = _load(builder, _place(context, builder, signature.args[0], v, at))
        _store(builder, row, _place(context, builder, signature.args[2], out, to))
        return context.get_dummy_value()

    return types.void(v, types.intp, out, types.intp), generate


@intrinsic
def add_row(typing, v, at, out, to):
    """out[to : to + 8] += v[at : at + 8], without bounds checks."""

    def generate(context, builder, signature, arguments):
        v, at, out, to = arguments
        row, place = (_place(context, builder, signature.args[n], a, i) for n, a, i in ((0, v, at), (2, out, to)))
        _store(builder, builder.fadd(_load(builder, row), _load(builder, place)), place)
        return context.get_dummy_value()

    return types.void(v, types.intp, out, types.intp), generate


@intrinsic
def transpose(typing, v, at):
    """Transpose v[at : at + 64], an 8 x 8 matrix, in place, without bounds checks."""

    def generate(context, builder, signature, arguments):
        v, at = arguments
        first = _place(context, builder, signature.args[0], v, at)
        places = [builder.gep(first, [ir.Constant(ir.IntType(32), i)]) for i in EIGHT]
        rows = [_load(builder, place) for place in places]
        for half in (4, 2, 1):  # swap the off-diagonal blocks of size `half` of each block of twice the size
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
    """Intrinsic for a matrix product: four rows of one matrix times `columns` of the other, a multiple of 8."""

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


# multiply_N(v, at, depth, u, of, width, out, to), without bounds checks, for i < 4:
# out[to + width i : to + width i + N] <- sum over c < depth of v[at + depth i + c] u[of + width c : of + width c + N]
multiply_16, multiply_24 = _product(16), _product(24)
