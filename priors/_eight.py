"""Eight float32 in a row as one vector: of rows that lie anywhere, or of squares of them, LLVM makes none by itself."""

from typing import Any

from llvmlite import ir
from numba import extending, types

intrinsic: Any = extending.intrinsic  # what it makes of a function takes all but the first argument
EIGHT, ROW = range(8), ir.VectorType(ir.FloatType(), 8)


def _place(context, builder, kind, array, at):
    """Where the row of an array begins that has its first value there."""
    assert kind.dtype == types.float32, kind
    first = builder.gep(context.make_array(kind)(context, builder, array).data, [at])
    return builder.bitcast(first, ROW.as_pointer())


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
