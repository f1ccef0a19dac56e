"""Functions over arrays, compiled by numba, called by address without the interpreter.

What this project needs to know about numba beyond its documented interface stands in this module alone:
where the machine code of a compiled function is, how it is called so that an exception in it is
noticed (the C wrapper that numba offers prints the exception and goes on), and how the exception is read.
"""

from __future__ import annotations

import ctypes
import inspect
import pickle
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, overload

from llvmlite import ir
from numba import njit, types
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from co_sim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = [
    "ARRAY_STEP",
    "EXCHANGE",
    "RAISED",
    "address_of",
    "assembled",
    "call_array_step",
    "compiled",
    "exception_at",
    "parts_of",
]

_ARRAY = types.Array(types.float64, 1, "C")
#: ``step(t, h, u, y, x, p)`` and ``exchange(t, u, y, x, p)``.
ARRAY_STEP = types.int32(types.float64, types.float64, _ARRAY, _ARRAY, _ARRAY, _ARRAY)
EXCHANGE = types.int32(types.float64, _ARRAY, _ARRAY, _ARRAY, _ARRAY)
#: Status of a step that raised an exception; far from the numbers that people choose.
RAISED = -(2**31)

_NAMES = {6: "step(t, h, u, y, x, p)", 5: "exchange(t, u, y, x, p)"}


@overload
def compiled(function: Callable[..., int], /) -> Any: ...
@overload
def compiled(*, boundscheck: bool = False) -> Callable[[Callable[..., int]], Any]: ...


def compiled(function: Callable[..., int] | None = None, /, *, boundscheck: bool = False) -> Any:
    """Compile the step or the exchange of a `CompiledComponent` (decorator).

    In a module file the machine code is cached: later processes load it, and no process compiles it
    twice. Functions typed into a prompt are compiled each time.

    Parameters
    ----------
    function : ``step(t, h, u, y, x, p)`` or ``exchange(t, u, y, x, p)``, with everything in it that numba
        compiles in nopython mode. The arrays are float64, one-dimensional and contiguous. It returns 0,
        or another whole number for a failure; an exception that it raises is a failure too.
    boundscheck : whether an index out of bounds raises an IndexError, at some cost in speed. Without the
        check such an index reads or changes memory of others.

    Raises
    ------
    InputError
        If the function takes other arguments, or numba cannot compile it.
    """
    if function is None:
        return lambda each: _compile(each, boundscheck)
    return _compile(function, boundscheck)


def _compile(function: Callable[..., int], boundscheck: bool) -> Any:
    what = f"compiled function {getattr(function, '__qualname__', function)}"
    signature = {6: ARRAY_STEP, 5: EXCHANGE}.get(len(inspect.signature(function).parameters))
    if signature is None:
        raise InputError(
            what,
            got=f"the arguments {inspect.signature(function)}",
            expected=" or ".join(_NAMES.values()),
            remedy="give it these arguments, also those it does not need",
        )
    jit: Any = partial(njit, signature, nogil=True, error_model="numpy", boundscheck=boundscheck)
    try:
        try:
            done = jit(cache=True)(function)
        except RuntimeError as error:
            if "cannot cache" not in str(error):
                raise
            # Typed into a prompt, or nowhere to write: numba has no file to keep the machine code in.
            done = jit()(function)
        # A function that never returns compiles, with another type of its result.
        done.get_compile_result(signature)
    except NumbaError as error:
        raise InputError(
            what,
            got=str(error).strip(),
            expected="what numba compiles in nopython mode, returning a whole number on every path",
            remedy="change the lines named above, or use a FunctionComponent",
        ) from error
    return done


def as_compiled(function: Any, n_arguments: int) -> Any:
    """Return `function` compiled, as it is where `compiled` has been there already.

    Raises
    ------
    InputError
        If it takes another number of arguments or was compiled for other types.
    """
    plain = getattr(function, "py_func", function)
    if not callable(plain) or len(inspect.signature(plain).parameters) != n_arguments:
        raise InputError(
            f"compiled function {getattr(plain, '__qualname__', plain)}",
            got=f"the arguments {inspect.signature(plain)}" if callable(plain) else "no function",
            expected=_NAMES[n_arguments],
            remedy="give it these arguments, also those it does not need",
        )
    signature = ARRAY_STEP if n_arguments == 6 else EXCHANGE
    if isinstance(function, Dispatcher) and signature in function.nopython_signatures:
        return function
    return compiled(plain)


def parts_of(function: Dispatcher[Any]) -> tuple[type, Any, dict[str, Any], list[Any], bool]:
    """Return what `assembled` needs to make the same compiled function in another process."""
    signatures = list(function.nopython_signatures)
    cached = not isinstance(function._cache, NullCache)  # type: ignore[attr-defined]
    return type(function), function.py_func, function.targetoptions, signatures, cached


def assembled(kind: type, plain: Any, options: dict[str, Any], signatures: list[Any], cached: bool) -> Any:
    """Return a compiled function from its parts, with its machine code from the cache if it is there."""
    function = kind(plain, {}, options)
    if cached:
        with suppress(RuntimeError):  # Its file is out of reach here.
            function.enable_caching()
    for signature in signatures:
        function.compile(signature)
    function.disable_compile()
    return function


def address_of(function: Any, signature: Any) -> int:
    """Return the address of the machine code of a function that `compiled` returned."""
    result = function.get_compile_result(signature)
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))


def _call_array_step(typing_context: Any, address: Any, arguments: Any) -> Any:

    def generate(context: Any, builder: Any, _: Any, values: Any) -> Any:
        convention = context.call_conv
        function_type = convention.get_function_type(ARRAY_STEP.return_type, ARRAY_STEP.args)
        function = builder.inttoptr(values[0], function_type.as_pointer())
        unpacked = [builder.extract_value(values[1], i) for i in range(len(ARRAY_STEP.args))]
        status, returned = convention.call_function(
            builder, function, ARRAY_STEP.return_type, ARRAY_STEP.args, unpacked
        )
        raised = ir.Constant(returned.type, RAISED)
        exception = builder.ptrtoint(status.excinfoptr, context.get_value_type(types.intp))
        return context.make_tuple(
            builder, returns, (builder.select(status.is_error, raised, returned), exception)
        )

    returns = types.Tuple((types.int32, types.intp))
    return returns(types.intp, types.Tuple(ARRAY_STEP.args)), generate


#: For compiled code: ``call_array_step(address, arguments)`` calls the `ARRAY_STEP` at an address and
#: returns its status and, where that is `RAISED`, the address of the exception.
call_array_step: Any = intrinsic(_call_array_step)


class _ExceptionInfo(ctypes.Structure):
    """What numba keeps of an exception: the pickled class and arguments, unless they are `dynamic`."""

    _fields_ = (
        ("pickled", ctypes.c_void_p),
        ("size", ctypes.c_int32),
        ("values", ctypes.c_void_p),
        ("unwrap", ctypes.c_void_p),
        ("dynamic", ctypes.c_int32),
    )


def exception_at(address: int) -> Exception:
    """Return the exception at an address that `call_array_step` gave."""
    info = _ExceptionInfo.from_address(address) if address else None
    if info is None or info.dynamic > 0:
        # Its arguments were computed by the compiled code and lie in memory that only numba can read.
        return RuntimeError("it raised an exception; its text is lost, because it is not a constant")
    raised, arguments, _ = pickle.loads(ctypes.string_at(info.pickled, info.size))
    return raised(*(arguments or ()))  # type: ignore[no-any-return]
