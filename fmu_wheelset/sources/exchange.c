#include "exchange.h"

#include <math.h>
#include <string.h>

Status exchange_require(Instance *instance, int phases, const char *function)
{
    if (instance && instance->component.interface != MODEL_EXCHANGE)
        return component_fail(instance, "%s: not allowed in co-simulation; instantiate for model exchange", function);
    return component_require(instance, phases, function);
}

static Status check_number(Instance *instance, const char *what, size_t n, size_t expected)
{
    if (n == expected)
        return STATUS_OK;
    return component_fail(instance, "%s: got an array of %lu, expected %lu", what, (unsigned long)n,
                          (unsigned long)expected);
}

static Status check_states(Instance *instance, const double values[], size_t n)
{
    if (check_number(instance, "continuous states", n, N_STATES) != STATUS_OK)
        return STATUS_ERROR;
    return component_require_arrays(instance, n, values, values);
}

static Status check_finite(Instance *instance, const char *what, const double values[])
{
    for (int i = 0; i < N_STATES; i++)
        if (!isfinite(values[i]))
            return component_discard(instance, "%s %d: got %g at %.12g s, expected a finite number; try a smaller "
                                     "step", what, i, values[i], instance->component.time);
    return STATUS_OK;
}

Status exchange_set_time(Instance *instance, double time)
{
    if (!isfinite(time))
        return component_fail(instance, "time: got %g, expected a finite number of seconds", time);
    instance->component.time = time; /* on which nothing else depends */
    return STATUS_OK;
}

Status exchange_set_states(Instance *instance, const double x[], size_t n)
{
    if (check_states(instance, x, n) != STATUS_OK)
        return STATUS_ERROR;
    if (check_finite(instance, "continuous state", x) != STATUS_OK)
        return STATUS_DISCARD;
    memcpy(instance->component.wheelset.x, x, n * sizeof *x);
    instance->component.evaluated = 0;
    return STATUS_OK;
}

/* Until the run begins, states without start value follow the inputs. */
static Wheelset *present(Component *component)
{
    if (component->phase & STARTING)
        component_prepare(component, EVALUATED);
    return &component->wheelset;
}

Status exchange_get_states(Instance *instance, double x[], size_t n)
{
    if (check_states(instance, x, n) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(x, present(&instance->component)->x, n * sizeof *x);
    return check_finite(instance, "continuous state", x);
}

Status exchange_get_derivatives(Instance *instance, double x_dot[], size_t n)
{
    if (check_states(instance, x_dot, n) != STATUS_OK)
        return STATUS_ERROR;
    const Wheelset *wheelset = present(&instance->component);
    wheelset_derivatives(wheelset, wheelset->x, x_dot);
    return check_finite(instance, "derivative of continuous state", x_dot);
}

Status exchange_get_nominals(Instance *instance, double nominals[], size_t n)
{
    if (check_states(instance, nominals, n) != STATUS_OK)
        return STATUS_ERROR;
    memcpy(nominals, COMPONENT_NOMINALS, n * sizeof *nominals);
    return STATUS_OK;
}

Status exchange_get_indicators(Instance *instance, size_t n)
{
    return check_number(instance, "event indicators", n, 0);
}
