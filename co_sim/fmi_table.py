"""The table from which a compiled step of an FMU works: an array of int64.

`HEADER` numbers about the instance come first, then a row of `ROW` numbers for each call that sets inputs,
then one for each call that gets outputs. Addresses and numbers of elements are stored alike.
`co_sim.fmi_binding` fills it in for `co_sim.kernel`, `co_sim.iterated_kernel`, `co_sim.fmi_step`,
`co_sim.fmi_step_mixed` and `co_sim.fmi_state`. Their machine code is cached by the dates of their own files:
a change here must touch them too.
"""

from __future__ import annotations

(
    #: The instance; its doStep; whether no earlier state will be restored; version of FMI.
    INSTANCE,
    DO_STEP,
    NEVER_BACK,
    VERSION,
    #: Where FMI 3 writes how a step ended: flags as bytes (event, terminate, early return), and a time.
    FLAGS,
    LAST,
    #: Of a step that failed: the status of the call, or element of u or y and value that do not fit.
    STATUS,
    ELEMENT,
    VALUE,
    #: Numbers of rows that set and that get; numbers of elements of u (values) and y.
    N_SET,
    N_GET,
    N_INPUTS,
    N_OUTPUTS,
    #: Derivatives of inputs (FMI 2): function, number of inputs that have them, addresses of references,
    #: orders, values and positions in u, and the order that was set last.
    SET_DERIVATIVES,
    N_SLOPES,
    SLOPE_REFERENCES,
    SLOPE_ORDERS,
    SLOPE_VALUES,
    SLOPE_POSITIONS,
    LAST_ORDER,
    #: The state that was kept, as the FMU gave it, the order of derivatives that belongs to it, and the
    #: functions that get, set and free a state.
    KEPT,
    KEPT_ORDER,
    GET_STATE,
    SET_STATE,
    FREE_STATE,
) = range(25)
HEADER = 25

#: Of a row: function, references, number of them and of their values, code of the type, addresses of the
#: values and of their positions in u or y, and the limits of whole numbers.
FUNCTION, REFERENCES, N_REFERENCES, N_VALUES, CODE, VALUES, POSITIONS, LOW, HIGH = range(9)
ROW = 9

#: What a step, or what keeps and goes back, returns when it fails.
(
    SETTING,
    STEPPING,
    GETTING,
    ENDED,
    UNFIT_INPUT,
    UNFIT_OUTPUT,
    DERIVING,
    KEEPING,
    GOING_BACK,
    FREEING,
) = range(1, 11)

#: Types of values in C by their code; booleans are one byte in FMI 3 and an int in FMI 2.
(
    FLOAT64,
    FLOAT32,
    INT8,
    UINT8,
    INT16,
    UINT16,
    INT32,
    UINT32,
    INT64,
    UINT64,
    BOOLEAN8,
    BOOLEAN32,
) = range(12)

#: Largest whole number up to which float64 holds every one.
EXACT = 2**53
