"""Rows of small matrices as values in compiled code, four numbers to an instruction.

The compiler unrolls loops over so few numbers into single ones before it looks for what it may do at once,
and has to expect that whatever is written to one array changes the others. A row that is read once, kept and
written back leaves it no doubt. Operations are those of IEEE 754 in the order in which they are written, so
that results are the same bits wherever a kernel is inlined.

`row(A, i)` and `quad(A, i)` read row i of a matrix of twelve columns, all of it or its first four numbers;
`put(A, i, r)` writes it. Rows add, subtract and multiply by each other and by numbers; `total(r)` sums one.
`transpose(A, i, B, j)` writes twelve rows of A from row i on as columns to B from row j on. Rows are counted
through an array of more dimensions.
"""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model
from numpy.typing import NDArray

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["put", "quad", "row", "total", "transpose"]

_COLUMNS = 12
_WIDTH = 4
_F64 = ir.DoubleType()
_QUAD = ir.VectorType(_F64, _WIDTH)
_I32 = ir.IntType(32)


class _Row(types.Type):
    """A row of `quads` times four numbers."""

    def __init__(self, quads: int) -> None:
        self.quads = quads
        super().__init__(name=f"Row({quads})")


_ROW, _SHORT = _Row(_COLUMNS // _WIDTH), _Row(1)


@register_model(_Row)
class _RowModel(models.PrimitiveModel):
    """Vectors of four."""

    def __init__(self, dmm: Any, fe_type: _Row) -> None:
        super().__init__(dmm, fe_type, ir.ArrayType(_QUAD, fe_type.quads))  # type: ignore[no-untyped-call]


def _address(context: Any, builder: Any, signature: Any, A: Any, i: Any, quad: int) -> Any:
    """Return where a quad of row `i` of the matrix `A` stands."""
    data = context.make_array(signature.args[0])(context, builder, A).data
    at = context.cast(builder, i, signature.args[1], types.intp)
    at = builder.add(
        builder.mul(at, context.get_constant(types.intp, _COLUMNS)),
        context.get_constant(types.intp, quad * _WIDTH),
    )
    return builder.bitcast(builder.gep(data, [at], inbounds=True), _QUAD.as_pointer())


def _is_matrix(A: Any) -> bool:
    return isinstance(A, types.Array) and A.layout == "C" and A.dtype == types.float64


def _reader(kind: _Row) -> Any:
    """Return an intrinsic that reads a row of that kind."""

    def read(typing: Any, A: Any, i: Any) -> Any:
        del typing
        if not (_is_matrix(A) and isinstance(i, types.Integer)):
            return None

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            found = cgutils.get_null_value(context.get_value_type(kind))
            for n in range(kind.quads):
                at = _address(context, builder, signature, args[0], args[1], n)
                found = builder.insert_value(found, builder.load(at, align=8), n)
            return found

        return kind(A, i), generate

    return intrinsic(read)


@intrinsic
def _put(typing: Any, A: Any, i: Any, r: Any) -> Any:
    """Write the row r to row i of the matrix A of twelve columns."""
    del typing
    if not (_is_matrix(A) and isinstance(i, types.Integer) and isinstance(r, _Row)):
        return None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        for n in range(r.quads):
            at = _address(context, builder, signature, args[0], args[1], n)
            builder.store(builder.extract_value(args[2], n), at, align=8)
        return context.get_dummy_value()

    return types.void(A, i, r), generate


@intrinsic
def _total(typing: Any, r: Any) -> Any:
    """Return the sum of a row: of its quads first, then of pairs."""
    del typing
    if not isinstance(r, _Row):
        return None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        del context, signature
        found = builder.extract_value(args[0], 0)
        for n in range(1, r.quads):
            found = builder.fadd(found, builder.extract_value(args[0], n))
        single = [builder.extract_element(found, _I32(k)) for k in range(_WIDTH)]
        return builder.fadd(builder.fadd(single[0], single[2]), builder.fadd(single[1], single[3]))

    return types.float64(r), generate


@intrinsic
def _transpose(typing: Any, A: Any, i: Any, B: Any, j: Any) -> Any:
    """Write the rows of A from i on as columns to B from row j on, twelve of each; A and B do not overlap."""
    del typing
    if not (_is_matrix(A) and _is_matrix(B) and all(isinstance(at, types.Integer) for at in (i, j))):
        return None

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        at_i, at_j = (context.cast(builder, args[k], signature.args[k], types.intp) for k in (1, 3))
        source, target = types.void(A, types.intp), types.void(B, types.intp)
        for m in range(0, _COLUMNS, _WIDTH):
            for n in range(0, _COLUMNS, _WIDTH):
                block = []
                for k in range(_WIDTH):
                    from_row = builder.add(at_i, context.get_constant(types.intp, m + k))
                    at = _address(context, builder, source, args[0], from_row, n // _WIDTH)
                    block.append(builder.load(at, align=8))
                for k, turned in enumerate(_turned(builder, block)):
                    to_row = builder.add(at_j, context.get_constant(types.intp, n + k))
                    at = _address(context, builder, target, args[2], to_row, m // _WIDTH)
                    builder.store(turned, at, align=8)
        return context.get_dummy_value()

    return types.void(A, i, B, j), generate


def _turned(builder: Any, block: list[Any]) -> list[Any]:
    """Return the columns of four quads."""

    def mixed(a: Any, b: Any, which: list[int]) -> Any:
        return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_I32, _WIDTH), which))

    low = [mixed(block[k], block[k + 1], [0, 4, 2, 6]) for k in (0, 2)]
    high = [mixed(block[k], block[k + 1], [1, 5, 3, 7]) for k in (0, 2)]
    first, last = [0, 1, 4, 5], [2, 3, 6, 7]
    return [
        mixed(low[0], low[1], first),
        mixed(high[0], high[1], first),
        mixed(low[0], low[1], last),
        mixed(high[0], high[1], last),
    ]


def _spread(builder: Any, number: Any) -> Any:
    """Return a quad of equal numbers."""
    one = builder.insert_element(ir.Constant(_QUAD, ir.Undefined), number, _I32(0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(_I32, _WIDTH), [0] * _WIDTH))


def _elementwise(instruction: str) -> Any:
    """Return an intrinsic that does an instruction to two rows, or to a row and a number."""

    def apply(typing: Any, a: Any, b: Any) -> Any:
        del typing
        kind = a if isinstance(a, _Row) else b

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pair = [
                value if isinstance(given, _Row)
                else _spread(builder, context.cast(builder, value, given, types.float64))
                for value, given in zip(args, signature.args, strict=True)
            ]  # fmt: skip
            found = cgutils.get_null_value(context.get_value_type(kind))
            for n in range(kind.quads):
                x, y = (
                    builder.extract_value(value, n) if isinstance(given, _Row) else value
                    for value, given in zip(pair, signature.args, strict=True)
                )
                found = builder.insert_value(found, getattr(builder, instruction)(x, y), n)
            return found

        return kind(a, b), generate

    return intrinsic(apply)


def _overload(of: Callable[..., object], instruction: str, *, numbers: bool) -> None:
    """Let rows take an operator of Python."""
    act = _elementwise(instruction)

    def both(a: Any, b: Any) -> Any:
        return act(a, b)

    def implementation(a: Any, b: Any) -> Any:
        given = [isinstance(kind, _Row) for kind in (a, b)]
        number = [isinstance(kind, types.Float) for kind in (a, b)]
        if (all(given) and a == b) or (numbers and any(given) and any(number)):
            return both
        return None

    overload(of, jit_options={"forceinline": True})(implementation)


_overload(operator.add, "fadd", numbers=False)
_overload(operator.sub, "fsub", numbers=False)
_overload(operator.mul, "fmul", numbers=True)

Array = NDArray[np.float64]
row: Callable[[Array, int], Any] = _reader(_ROW)
quad: Callable[[Array, int], Any] = _reader(_SHORT)
put: Callable[[Array, int, Any], None] = cast("Any", _put)
total: Callable[[Any], float] = cast("Any", _total)
transpose: Callable[[Array, int, Array, int], None] = cast("Any", _transpose)
