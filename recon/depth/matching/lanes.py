"""Sixteen float32 side by side in a register, for kernels in which a disparity is a lane.

numba's vectoriser does not see through recursions along a row. With these functions a kernel states itself what
happens to sixteen disparities at once, and runs seven times faster (measured on a Teddy-size pair).
A lane operation compiles to the processor's instruction where it has one and to several where it has not; the
results are the same. Arrays must be contiguous; an index counts elements of the flat array and is not checked.
"""

from __future__ import annotations

from collections.abc import Callable
from inspect import Parameter, Signature
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

N_LANES = 16
ONE_BITS = 0x3F800000  # of a float32 that is 1

_FLOATS = ir.VectorType(ir.FloatType(), N_LANES)
_EIGHT = ir.VectorType(ir.FloatType(), 8)
_WORD = ir.IntType(32)
_WORDS = ir.VectorType(_WORD, N_LANES)
_BYTES = ir.VectorType(ir.IntType(8), 4 * N_LANES)
_EVERY_LANE = list(range(N_LANES))


class _LanesType(types.Type):  # type: ignore[misc]  # numba carries no types
    def __init__(self) -> None:
        super().__init__(name="lanes of float32")


_LANES = _LanesType()


@register_model(_LanesType)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]  # numba carries no types
    def __init__(self, manager: Any, lanes: Any) -> None:
        super().__init__(manager, lanes, _FLOATS)


def _operation(result: Any, *operands: Any) -> Callable[[Callable[..., Any]], Any]:
    """Make a function that numba compiles of one that builds its instructions.

    Parameters
    ----------
    result, operands : numba's types; `Any` takes an array of 32-bit elements, whose next operand is an index: it is
        built with one pointer to that element instead of both
    """

    def made(build: Callable[..., Any]) -> Any:
        def typed(_typing: Any, *given: Any) -> Any:
            def generate(context: Any, builder: Any, accepted: Any, values: Any) -> Any:
                ready, left = [], iter(zip(accepted.args, values, strict=True))
                for kind, value in left:
                    if isinstance(kind, types.Array):
                        data = context.make_array(kind)(context, builder, value).data
                        value = builder.gep(data, [next(left)[1]])
                    ready.append(value)
                returned = build(builder, *ready)
                return context.get_dummy_value() if result is types.void else returned

            taken = (given[place] if kind is Any else kind for place, kind in enumerate(operands))
            return result(*taken), generate

        typed.__doc__, typed.__name__ = build.__doc__, build.__name__
        names = ["typing", *(f"operand_{place}" for place in range(len(operands)))]
        typed.__signature__ = Signature([Parameter(name, Parameter.POSITIONAL_OR_KEYWORD) for name in names])  # type: ignore[attr-defined]
        return intrinsic(typed)

    return made


@_operation(_LANES)
def zeros(_builder: Any) -> Any:
    """Return zero in every lane."""
    return ir.Constant(_FLOATS, [0.0] * N_LANES)


@_operation(_LANES, Any, types.intp)
def load(builder: Any, element: Any) -> Any:
    """Return `array[index : index + 16]` of a float32 array."""
    return _read(builder, element, _FLOATS)


@_operation(types.void, Any, types.intp, _LANES)
def store(builder: Any, element: Any, lanes: Any) -> None:
    """Set `array[index : index + 16] = lanes` of a float32 array."""
    builder.store(lanes, builder.bitcast(element, _FLOATS.as_pointer()), align=4)


@_operation(_LANES, Any, types.intp)
def load_eight(builder: Any, element: Any) -> Any:
    """Return `array[index : index + 8]` of a float32 array in the first lanes, zero in the others."""
    eight = _read(builder, element, _EIGHT)
    return builder.shuffle_vector(eight, ir.Constant(_EIGHT, [0.0] * 8), ir.Constant(_WORDS, _EVERY_LANE))


@_operation(types.void, Any, types.intp, _LANES)
def store_eight(builder: Any, element: Any, lanes: Any) -> None:
    """Set `array[index : index + 8]` of a float32 array to the first eight lanes."""
    eight = builder.shuffle_vector(lanes, lanes, ir.Constant(ir.VectorType(_WORD, 8), _EVERY_LANE[:8]))
    builder.store(eight, builder.bitcast(element, _EIGHT.as_pointer()), align=4)


@_operation(_LANES, _LANES, _LANES)
def add(builder: Any, first: Any, second: Any) -> Any:
    """Return `first + second` lane by lane."""
    return builder.fadd(first, second)


@_operation(_LANES, _LANES, types.float32, _LANES)
def add_scaled(builder: Any, lanes: Any, factor: Any, others: Any) -> Any:
    """Return `lanes + factor * others` lane by lane with one rounding.

    Parameters
    ----------
    lanes, others : 16 float32 each
    factor : one float32
    """
    return _fused(builder, _spread(builder, factor, _FLOATS), others, lanes)


@_operation(_LANES, _LANES, types.intp)
def spread_lane(builder: Any, lanes: Any, which: Any) -> Any:
    """Return one lane's number in every lane."""
    return _spread(builder, builder.extract_element(lanes, builder.trunc(which, _WORD)), _FLOATS)


@_operation(_LANES, _LANES)
def moved_down(builder: Any, lanes: Any) -> Any:
    """Return in every lane the number of the next one; the last keeps its own."""
    return builder.shuffle_vector(lanes, lanes, ir.Constant(_WORDS, [*_EVERY_LANE[1:], N_LANES - 1]))


@_operation(_LANES, _LANES)
def moved_up(builder: Any, lanes: Any) -> Any:
    """Return in every lane the number of the one before; the first keeps its own."""
    return builder.shuffle_vector(lanes, lanes, ir.Constant(_WORDS, [0, *_EVERY_LANE[:-1]]))


@_operation(_LANES, types.uint32, Any, types.intp)
def hamming(builder: Any, code: Any, element: Any) -> Any:
    """Count the bits in which a uint32 code differs from each of `codes[index : index + 16]`."""
    differing = builder.xor(_spread(builder, code, _WORDS), _read(builder, element, _WORDS))
    count = _llvm(builder, "llvm.ctpop.v16i32", _WORDS, _WORDS)
    return builder.sitofp(builder.call(count, [differing]), _FLOATS)


@_operation(types.int32, _LANES, types.int32, types.int32, types.int32)
def lowest(builder: Any, lanes: Any, first: Any, last: Any, flip: Any) -> Any:
    """Return the lowest of some lanes as one int32.

    Its upper 28 bits are those of the float32 and order as it does; its lower 4 are the lane, exclusive-or `flip`,
    so that of equal lanes the first wins with a flip of 0, the last with a flip of 15.

    Parameters
    ----------
    lanes : 16 float32, not negative
    first, last, flip : int32, the lanes that count, and 0 or 15
    """
    number = ir.Constant(_WORDS, _EVERY_LANE)
    marks = builder.xor(number, _spread(builder, flip, _WORDS))
    cost = builder.and_(builder.bitcast(lanes, _WORDS), ir.Constant(_WORDS, [-N_LANES] * N_LANES))
    allowed = builder.and_(
        builder.icmp_signed(">=", number, _spread(builder, first, _WORDS)),
        builder.icmp_signed("<=", number, _spread(builder, last, _WORDS)),
    )
    keys = builder.select(allowed, builder.or_(cost, marks), ir.Constant(_WORDS, [0x7FFFFFFF] * N_LANES))
    return builder.call(_llvm(builder, "llvm.vector.reduce.smin.v16i32", _WORD, _WORDS), [keys])


@_operation(_LANES, Any, types.intp, types.float32, types.float32, types.intp)
def gather(builder: Any, element: Any, first: Any, step: Any, last: Any) -> Any:
    """Return `words[start + clip(round(first + k * step), 0, last)]` in lane k, their bits as they are.

    Parameters
    ----------
    element : `words`, elements of 32 bits, and `start`
    first, step : float32
    last : the largest index from `start` on
    """
    numbers = ir.Constant(_FLOATS, [float(lane) for lane in _EVERY_LANE])
    exact = _fused(builder, _spread(builder, step, _FLOATS), numbers, _spread(builder, first, _FLOATS))
    rounded = builder.call(_llvm(builder, "llvm.rint.v16f32", _FLOATS, _FLOATS), [exact])
    index = _clipped(builder, builder.fptosi(rounded, _WORDS), _spread(builder, builder.trunc(last, _WORD), _WORDS))
    return _gathered(builder, element, index)


@_operation(_LANES, _LANES, types.float32)
def falling(builder: Any, lanes: Any, fall: Any) -> Any:
    """Return 2 ** -n, in a straight line between whole n, for n = lanes * fall / 2 ** 23; the lanes are not negative.

    The bits of a float32 are those of its exponent before those of its fraction: counted down, they fall like this.
    """
    most = ir.Constant(_FLOATS, [float(ONE_BITS)] * N_LANES)
    down = builder.fmul(lanes, _spread(builder, fall, _FLOATS))
    down = builder.select(builder.fcmp_ordered("<", down, most), down, most)
    bits = builder.sub(ir.Constant(_WORDS, [ONE_BITS] * N_LANES), builder.fptosi(down, _WORDS))
    return builder.bitcast(bits, _FLOATS)


@_operation(_LANES, _LANES)
def lower_half(builder: Any, lanes: Any) -> Any:
    """Return the lower 16 bits of every lane as an unsigned whole number."""
    words = builder.and_(builder.bitcast(lanes, _WORDS), ir.Constant(_WORDS, [0xFFFF] * N_LANES))
    return builder.sitofp(words, _FLOATS)


@_operation(_LANES, _LANES)
def upper_half(builder: Any, lanes: Any) -> Any:
    """Return the upper 16 bits of every lane as a signed whole number."""
    words = builder.ashr(builder.bitcast(lanes, _WORDS), ir.Constant(_WORDS, [16] * N_LANES))
    return builder.sitofp(words, _FLOATS)


@_operation(_LANES, types.uint32, _LANES)
def byte_distance(builder: Any, word: Any, lanes: Any) -> Any:
    """Return the sum over the four bytes of |byte of a uint32 - byte of the lane's bits|."""
    sides = [builder.bitcast(words, _BYTES) for words in (_spread(builder, word, _WORDS), lanes)]
    larger, smaller = (
        builder.call(_llvm(builder, f"llvm.u{extreme}.v64i8", _BYTES, _BYTES, _BYTES), sides)
        for extreme in ("max", "min")
    )
    sums = builder.bitcast(builder.sub(larger, smaller), _WORDS)
    for shift, mask in ((8, 0x00FF00FF), (16, 0x0000FFFF)):  # of bytes in pairs, then of the pairs
        shifted = builder.lshr(sums, ir.Constant(_WORDS, [shift] * N_LANES))
        kept = [builder.and_(part, ir.Constant(_WORDS, [mask] * N_LANES)) for part in (sums, shifted)]
        sums = builder.add(*kept)
    return builder.sitofp(sums, _FLOATS)


@_operation(_LANES, _LANES, _LANES, types.float32)
def truncated_difference(builder: Any, first: Any, second: Any, most: Any) -> Any:
    """Return `min(|first - second|, most)` lane by lane.

    Parameters
    ----------
    first, second : 16 float32 each
    most : one float32
    """
    absolute = _llvm(builder, "llvm.fabs.v16f32", _FLOATS, _FLOATS)
    difference, limit = builder.call(absolute, [builder.fsub(first, second)]), _spread(builder, most, _FLOATS)
    return builder.select(builder.fcmp_ordered("<", difference, limit), difference, limit)


@_operation(_LANES, _LANES, _LANES)
def multiply(builder: Any, first: Any, second: Any) -> Any:
    """Return `first * second` lane by lane."""
    return builder.fmul(first, second)


@_operation(types.float32, _LANES)
def total(builder: Any, lanes: Any) -> Any:
    """Return the sum of all lanes, always added in the same order."""
    n_left = N_LANES
    while n_left > 1:
        n_left //= 2
        halves = [
            builder.shuffle_vector(lanes, lanes, ir.Constant(ir.VectorType(_WORD, n_left), list(places)))
            for places in (range(n_left), range(n_left, 2 * n_left))
        ]
        lanes = builder.fadd(*halves)
    return builder.extract_element(lanes, ir.Constant(_WORD, 0))


def _clipped(builder: Any, words: Any, last: Any) -> Any:
    zero = ir.Constant(_WORDS, [0] * N_LANES)
    words = builder.select(builder.icmp_signed("<", words, zero), zero, words)
    return builder.select(builder.icmp_signed(">", words, last), last, words)


def _gathered(builder: Any, element: Any, index: Any) -> Any:
    """Return the 32-bit elements that stand `index` after one."""
    address = ir.IntType(64)
    addresses = ir.VectorType(address, N_LANES)
    origin = builder.ptrtoint(element, address)
    unknown = ir.Constant(addresses, ir.Undefined)
    origins = builder.insert_element(unknown, origin, ir.Constant(_WORD, 0))
    origins = builder.shuffle_vector(origins, unknown, ir.Constant(_WORDS, [0] * N_LANES))
    distance = builder.shl(builder.sext(index, addresses), ir.Constant(addresses, [2] * N_LANES))
    pointer = ir.FloatType().as_pointer()
    pointers = builder.inttoptr(builder.add(origins, distance), ir.VectorType(pointer, N_LANES))
    mask = ir.VectorType(ir.IntType(1), N_LANES)
    read = _llvm(builder, "llvm.masked.gather.v16f32.v16p0", _FLOATS, pointers.type, _WORD, mask, _FLOATS)
    everywhere = ir.Constant(mask, [1] * N_LANES)
    return builder.call(read, [pointers, ir.Constant(_WORD, 4), everywhere, ir.Constant(_FLOATS, ir.Undefined)])


def _read(builder: Any, element: Any, vector: Any) -> Any:
    return builder.load(builder.bitcast(element, vector.as_pointer()), align=4)


def _fused(builder: Any, factor: Any, others: Any, added: Any) -> Any:
    """Return `factor * others + added` lane by lane with one rounding."""
    return builder.call(_llvm(builder, "llvm.fma.v16f32", *[_FLOATS] * 4), [factor, others, added])


def _spread(builder: Any, number: Any, vector: Any) -> Any:
    unknown = ir.Constant(vector, ir.Undefined)
    first = builder.insert_element(unknown, number, ir.Constant(_WORD, 0))
    return builder.shuffle_vector(first, unknown, ir.Constant(_WORDS, [0] * N_LANES))


def _llvm(builder: Any, name: str, result: Any, *operands: Any) -> Callable[..., Any]:
    """Declare an LLVM intrinsic on vectors, which llvmlite cannot name by itself."""
    function: Callable[..., Any] = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(result, operands), name
    )
    return function
