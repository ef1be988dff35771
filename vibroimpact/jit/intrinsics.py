"""Operations that Python lacks, as instructions of LLVM: each ``generate`` emits them."""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from vibroimpact.jit.hooks import HOOKS


@intrinsic
def fma(context, a, b, c):
    """a * b + c, rounded once."""

    def generate(context, builder, signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


@intrinsic
def select(context, condition, a, b):
    """`a` where the condition holds, else `b`: without a branch, which would not be vectorised."""

    def generate(context, builder, signature, arguments):
        condition, a, b = arguments
        as_bit = context.cast(builder, condition, types.boolean, types.boolean)
        return builder.select(as_bit, a, b)

    return types.float64(types.boolean, types.float64, types.float64), generate


@intrinsic
def widest_vectors(context):
    """Let LLVM use the widest vectors of the processor in the calling function.

    By default it keeps to 256 bits where the processor has 512. The stack is aligned, so that a
    vector put there for want of a register lies in one line of the cache.
    """

    def generate(context, builder, signature, arguments):
        attributes = builder.function.attributes
        if HOOKS:  # the set takes only attributes that llvmlite knows
            set.add(attributes, '"prefer-vector-width"="512"')
        attributes.add("noinline")
        attributes.alignstack = 64
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic
def claim(context, counter):
    """Count up the first element of an array of int64 for all threads; return what it was."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        single = context.get_constant(types.int64, 1)
        return builder.atomic_rmw("add", array.data, single, "monotonic")

    return types.int64(counter), generate


@intrinsic
def is_set(context, flag):
    """Whether another thread has set the first element of an array of int64; read every time."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        value = builder.load_atomic(array.data, "monotonic", 8)
        return builder.icmp_unsigned("!=", value, context.get_constant(types.int64, 0))

    return types.boolean(flag), generate


@intrinsic
def lowest_bit(context, bits):
    """The place of the lowest bit set in an integer that is not 0."""

    def generate(context, builder, signature, arguments):
        return builder.cttz(arguments[0], context.get_constant(types.boolean, 1))

    return types.int64(types.int64), generate


@intrinsic
def not_negative(context, array, first):
    """An integer with a bit for each of 64 elements from `first` on that is 0, more, or NaN."""

    def generate(context, builder, signature, arguments):
        row = context.make_array(signature.args[0])(context, builder, arguments[0])
        vector = ir.VectorType(ir.DoubleType(), 64)
        start = builder.gep(row.data, [arguments[1]])
        numbers = builder.load(builder.bitcast(start, vector.as_pointer()), align=8)
        zeros = ir.Constant(vector, [0.0] * 64)
        negative = builder.fcmp_ordered("<", numbers, zeros)
        return builder.not_(builder.bitcast(negative, ir.IntType(64)))

    return types.int64(array, types.intp), generate
