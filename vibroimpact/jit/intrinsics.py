"""Operations that Python lacks, as LLVM instructions; each ``generate`` emits them."""

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
