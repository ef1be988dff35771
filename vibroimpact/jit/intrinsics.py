"""Operations that Python lacks, as LLVM instructions."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from vibroimpact.jit.way import WAY


@intrinsic
def fma(context, a, b, c):
    """Return a * b + c, rounded once."""

    def generate(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


@intrinsic
def select(context, condition, a, b):
    """Return `a` if the condition holds, else `b`, without a branch that prevents vectorisation."""

    def generate(context, builder, signature, arguments):
        condition, a, b = arguments
        as_bit = context.cast(builder, condition, types.boolean, types.boolean)
        return builder.select(as_bit, a, b)

    return types.float64(types.boolean, types.float64, types.float64), generate


@intrinsic
def widest_vectors(context):
    """Let LLVM use the widest vectors of the processor in the calling function.

    By default it uses 256 bits even if the processor has 512. The stack is aligned so that a vector
    that does not fit into the registers lies in one cache line.
    """

    def generate(context, builder, signature, arguments):
        attributes = builder.function.attributes
        if WAY.name != "plain":  # the method of the set accepts only attributes that llvmlite knows
            set.add(attributes, '"prefer-vector-width"="512"')
        attributes.add("noinline")
        attributes.alignstack = 64
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic
def claim(context, counter):
    """Add 1 to the first element of an array of int64, atomically; return the old value."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        single = context.get_constant(types.int64, 1)
        return builder.atomic_rmw("add", array.data, single, "monotonic")

    return types.int64(counter), generate


@intrinsic
def is_set(context, flag):
    """Whether another thread has set the first element of an array of int64; never cached."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        value = builder.load_atomic(array.data, "monotonic", 8)
        return builder.icmp_unsigned("!=", value, context.get_constant(types.int64, 0))

    return types.boolean(flag), generate


@intrinsic
def lowest_bit(context, bits):
    """Return the position of the lowest bit set in an integer that is not 0."""

    def generate(context, builder, signature, arguments):
        return builder.cttz(arguments[0], context.get_constant(types.boolean, 1))

    return types.int64(types.int64), generate


@intrinsic
def not_negative(context, array, first):
    """Return 64 bits, one for each element from `first` on: 1 where it is >= 0 or NaN."""

    def generate(context, builder, signature, arguments):
        row = context.make_array(signature.args[0])(context, builder, arguments[0])
        vector = ir.VectorType(ir.DoubleType(), 64)
        start = builder.gep(row.data, [arguments[1]])
        numbers = builder.load(builder.bitcast(start, vector.as_pointer()), align=8)
        zeros = ir.Constant(vector, [0.0] * 64)
        negative = builder.fcmp_ordered("<", numbers, zeros)
        return builder.not_(builder.bitcast(negative, ir.IntType(64)))

    return types.int64(array, types.intp), generate


def _vector_at(context, builder, kind, array, at):
    """Return the address of 8 numbers of an array, from index `at` on."""
    start = builder.gep(context.make_array(kind)(context, builder, array).data, [at])
    return builder.bitcast(start, ir.VectorType(ir.DoubleType(), 8).as_pointer())


@intrinsic
def transpose(context, target, to, distance, source, at, lines, first):
    """Copy 8 lines of 8 numbers to rows: number q of line j to target[to + q distance + j].

    Line j begins at source[at + 8 lines[first + j]]. Vectors are shuffled in registers, which takes
    a third of the time of 64 copies.
    """

    def generate(context, builder, signature, arguments):
        target, to, distance, source, at, lines, first = arguments
        listed = context.make_array(signature.args[5])(context, builder, lines).data
        rows = []
        for j in range(8):
            line = builder.load(builder.gep(listed, [builder.add(first, first.type(j))]))
            start = builder.add(at, builder.mul(line, line.type(8)))
            address = _vector_at(context, builder, signature.args[3], source, start)
            rows.append(builder.load(address, align=8))
        places = ir.VectorType(ir.IntType(32), 8)
        for width in (4, 2, 1):  # exchange blocks of numbers between rows `width` apart
            other = [8 if q & width else 0 for q in range(8)]
            low = ir.Constant(places, [(q & ~width) + other[q] for q in range(8)])
            high = ir.Constant(places, [(q | width) + other[q] for q in range(8)])
            for a in range(8):
                if not a & width:
                    pair = rows[a], rows[a + width]
                    rows[a] = builder.shuffle_vector(*pair, low)
                    rows[a + width] = builder.shuffle_vector(*pair, high)
        for q, row in enumerate(rows):
            place = builder.add(to, builder.mul(distance, distance.type(q)))
            builder.store(
                row, _vector_at(context, builder, signature.args[0], target, place), align=8
            )
        return context.get_dummy_value()

    i = types.intp
    return types.void(target, i, i, source, i, lines, i), generate
