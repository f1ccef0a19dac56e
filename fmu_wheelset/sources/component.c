#include "component.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "variables.h" /* generated: TOKEN, VARIABLES, N_VARIABLES, STATE_NOMINALS */

const char *const INSTANTIATION_TOKEN = TOKEN;
const double *const COMPONENT_NOMINALS = STATE_NOMINALS;

/* Local error of the integrator. Over seconds of motion it gives global errors below 1e-6, mostly below 1e-7. */
static const double TOLERANCE = 1e-8;

static Status report(Instance *instance, Status status, const char *format, va_list arguments)
{
    char message[512];
    vsnprintf(message, sizeof message, format, arguments);
    if (instance->log)
        instance->log(instance, status, message);
    return status;
}

Status component_fail(Instance *instance, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const Status status = report(instance, STATUS_ERROR, format, arguments);
    va_end(arguments);
    return status;
}

Status component_discard(Instance *instance, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    const Status status = report(instance, STATUS_DISCARD, format, arguments);
    va_end(arguments);
    return status;
}

Status component_check_finite(Instance *instance, const char *what, double value)
{
    if (isfinite(value))
        return STATUS_OK;
    return component_discard(instance, "%s: got %g at %.12g s, expected a finite number; check inputs, parameters "
                             "and states", what, value, instance->component.time);
}

static const char *phase_name(int phase)
{
    switch (phase) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZATION: return "in initialization mode";
    case STEPPING: return "initialized";
    case EVENT: return "in event mode";
    case CONTINUOUS: return "in continuous-time mode";
    case TERMINATED: return "terminated";
    default: return "failed";
    }
}

Status component_require(Instance *instance, int phases, const char *function)
{
    if (!instance)
        return STATUS_ERROR;
    if (instance->component.phase & phases)
        return STATUS_OK;
    return component_fail(instance, "%s: not allowed while the instance is %s; check the order of calls",
                          function, phase_name(instance->component.phase));
}

Status component_unsupported(Instance *instance, const char *function)
{
    if (!instance)
        return STATUS_ERROR;
    return component_fail(instance, "%s: not supported by this FMU; see the capability flags in "
                          "modelDescription.xml", function);
}

void *component_location(Component *component, const Variable *variable)
{
    return (char *)component + variable->offset;
}

static void store(Component *component, const Variable *variable, double value)
{
    if (variable->kind == FLOAT64)
        *(double *)component_location(component, variable) = value;
    else
        *(int32_t *)component_location(component, variable) = (int32_t)value;
}

void component_reset(Component *component)
{
    const int32_t interface = component->interface;
    memset(component, 0, sizeof *component);
    component->interface = interface;
    component->phase = INSTANTIATED;
    for (size_t i = 0; i < N_VARIABLES; i++)
        if (VARIABLES[i].settable != READ_ONLY)
            store(component, &VARIABLES[i], VARIABLES[i].start);
}

void component_restart(Instance *instance)
{
    instance->component = instance->start;
}

static void invalidate(Component *component)
{
    component->evaluated = 0;
    /* Peaks depend on the contact state, which is compared, and on parameters, which then are fixed. */
    if (component->phase & STARTING)
        component->peak_known[LEFT] = component->peak_known[RIGHT] = 0;
}

Status component_set_times(Instance *instance, double start_time, int stop_time_defined, double stop_time)
{
    Component *component = &instance->component;
    if (!isfinite(start_time))
        return component_fail(instance, "start time: got %g, expected a finite number of seconds", start_time);
    if (stop_time_defined && !(stop_time >= start_time))
        return component_fail(instance, "stop time: got %g s, expected at least the start time of %g s",
                              stop_time, start_time);
    component->time = start_time;
    component->stop_time_defined = stop_time_defined;
    component->stop_time = stop_time;
    return STATUS_OK;
}

Status component_enter_initialization(Instance *instance)
{
    instance->component.phase = INITIALIZATION;
    return STATUS_OK;
}

/* Until the run begins, states without start value follow the inputs and parameters. */
static void follow_starts(Component *component)
{
    if (component->phase & STARTING)
        wheelset_initialise(&component->wheelset);
}

Status component_exit_initialization(Instance *instance)
{
    Component *component = &instance->component;
    const Parameters *p = &component->wheelset.p;
    if (!(fabs(p->delta_r) < 2.0 * p->r0))
        return component_fail(instance, "delta_r: got %g m, expected a difference of radii below 2 r0 = %g m",
                              p->delta_r, 2.0 * p->r0);
    follow_starts(component);
    component->phase = component->interface == MODEL_EXCHANGE ? EVENT : STEPPING;
    return STATUS_OK;
}

static void evaluate_outputs(Component *component)
{
    const Wheelset *wheelset = &component->wheelset;
    Evaluation e;
    if (component->evaluated)
        return;
    follow_starts(component);
    wheelset_evaluate(wheelset, wheelset->x, &e);
    wheelset_outputs(wheelset, wheelset->x, &e, &component->outputs);
    memcpy(component->x_dot, e.x_dot, sizeof e.x_dot);
    for (int i = LEFT; i <= RIGHT; i++) {
        e.at[i].creepage_x = e.at[i].creepage_y = 0.0; /* of no influence on the peak */
        if (memcmp(&component->peak_at[i], &e.at[i], sizeof e.at[i]) != 0) {
            component->peak_at[i] = e.at[i];
            component->peak_known[i] = 0;
        }
    }
    component->evaluated = 1;
}

static void evaluate_peak(Component *component, int side)
{
    evaluate_outputs(component);
    if (component->peak_known[side])
        return;
    component->peak[side] = contact_peak(&component->wheelset.p.patch, &component->peak_at[side]);
    component->peak_known[side] = 1;
}

void component_prepare(Component *component, Source source)
{
    switch (source) {
    case STORED: break;
    case EVALUATED: evaluate_outputs(component); break;
    case PEAK_LEFT: evaluate_peak(component, LEFT); break;
    case PEAK_RIGHT: evaluate_peak(component, RIGHT); break;
    }
}

const Variable *component_variable(uint32_t reference)
{
    return &VARIABLES[reference];
}

const Variable *component_find(Instance *instance, uint32_t reference, Kind kind)
{
    static const char *const KINDS[] = {"float", "enumeration", "Boolean"};
    if (reference >= N_VARIABLES) {
        component_fail(instance, "value reference: got %lu, expected less than %lu; see modelDescription.xml",
                       (unsigned long)reference, (unsigned long)N_VARIABLES);
        return 0;
    }
    if (VARIABLES[reference].kind != kind) {
        component_fail(instance, "%s: got access as %s, expected %s; see modelDescription.xml",
                       VARIABLES[reference].name, KINDS[kind], KINDS[VARIABLES[reference].kind]);
        return 0;
    }
    return &VARIABLES[reference];
}

static Status check_value(Instance *instance, const Variable *variable, double value)
{
    const int phase = instance->component.phase;
    const int phases = variable->settable == READ_ONLY  ? 0
                     : variable->settable == BEFORE_RUN ? STARTING
                                                        : STARTING | RUNNING;
    if (!(phase & phases))
        return component_fail(instance, "%s: cannot be set while the instance is %s; %s", variable->name,
                              phase_name(phase), phases ? "set it earlier" : "it is computed by the model");
    if (!(isfinite(value) && value >= variable->minimum && value <= variable->maximum))
        return component_fail(instance, "%s: got %g, expected a finite value from %g to %g; check what sets it",
                              variable->name, value, variable->minimum, variable->maximum);
    return STATUS_OK;
}

Status component_set_start(Instance *instance, uint32_t reference, double value)
{
    const Variable *variable = reference < N_VARIABLES ? &VARIABLES[reference] : 0;
    if (!variable || check_value(instance, variable, value) != STATUS_OK)
        return STATUS_ERROR;
    store(&instance->component, variable, value);
    return STATUS_OK;
}

Status component_require_arrays(Instance *instance, size_t n, const void *references, const void *values)
{
    if (n == 0 || (references && values))
        return STATUS_OK;
    return component_fail(instance, "variables: got a null array, expected %lu elements", (unsigned long)n);
}

Status component_get_reals(Instance *instance, const uint32_t references[], size_t n, double values[])
{
    if (component_require_arrays(instance, n, references, values) != STATUS_OK)
        return STATUS_ERROR;
    for (size_t i = 0; i < n; i++) {
        const Variable *variable = component_find(instance, references[i], FLOAT64);
        if (!variable)
            return STATUS_ERROR;
        component_prepare(&instance->component, variable->source);
        values[i] = *(const double *)component_location(&instance->component, variable);
        if (component_check_finite(instance, variable->name, values[i]) != STATUS_OK)
            return STATUS_DISCARD;
    }
    return STATUS_OK;
}

Status component_set_reals(Instance *instance, const uint32_t references[], size_t n, const double values[])
{
    if (component_require_arrays(instance, n, references, values) != STATUS_OK)
        return STATUS_ERROR;
    for (size_t i = 0; i < n; i++) {
        const Variable *variable = component_find(instance, references[i], FLOAT64);
        if (!variable || check_value(instance, variable, values[i]) != STATUS_OK)
            return STATUS_ERROR;
    }
    for (size_t i = 0; i < n; i++) {
        double *stored = component_location(&instance->component, &VARIABLES[references[i]]);
        if (*stored != values[i])
            instance->component.step_sizes.next = 0.0; /* x_dot jumps */
        *stored = values[i];
    }
    invalidate(&instance->component);
    return STATUS_OK;
}

Status component_get_integer(Instance *instance, Kind kind, uint32_t reference, int64_t *value)
{
    const Variable *variable = component_find(instance, reference, kind);
    if (!variable)
        return STATUS_ERROR;
    *value = *(const int32_t *)component_location(&instance->component, variable);
    return STATUS_OK;
}

Status component_check_integer(Instance *instance, Kind kind, uint32_t reference, int64_t value)
{
    const Variable *variable = component_find(instance, reference, kind);
    return variable ? check_value(instance, variable, (double)value) : STATUS_ERROR;
}

void component_set_integer(Instance *instance, uint32_t reference, int64_t value)
{
    store(&instance->component, &VARIABLES[reference], (double)value);
    invalidate(&instance->component);
}

static void evaluate_states(const void *model, const double x[], double x_dot[],
                            double J[][INTEGRATOR_MAX_STATES])
{
    const Wheelset *wheelset = model;
    if (!J) {
        wheelset_derivatives(wheelset, x, x_dot);
        return;
    }
    Evaluation e;
    wheelset_evaluate(wheelset, x, &e);
    wheelset_jacobian(wheelset, x, &e, J);
    memcpy(x_dot, e.x_dot, sizeof e.x_dot);
}

static Status check_step(Instance *instance, double time, double duration)
{
    const Component *component = &instance->component;
    if (!(isfinite(duration) && duration > 0.0))
        return component_fail(instance, "communication step size: got %g s, expected more than 0 s", duration);
    const double slack = 1e-9 * fmax(1.0, fabs(component->time));
    if (!(fabs(time - component->time) <= slack))
        return component_fail(instance, "communication point: got %.12g s, expected %.12g s where the last step "
                              "ended", time, component->time);
    if (!isfinite(time + duration))
        return component_fail(instance, "communication step: ends at %g s, expected a finite time", time + duration);
    if (component->stop_time_defined && time + duration > component->stop_time + slack)
        return component_fail(instance, "communication step: ends at %.12g s, expected at most the stop time of "
                              "%.12g s", time + duration, component->stop_time);
    return STATUS_OK;
}

Status component_step(Instance *instance, double time, double duration)
{
    static const char *const REASONS[] = {"", "the motion is singular or not finite", "it takes too many steps"};
    Component *component = &instance->component;
    if (check_step(instance, time, duration) != STATUS_OK)
        return STATUS_ERROR;

    OdeSystem system = {&component->wheelset, evaluate_states, N_STATES, 0, {0}, TOLERANCE, {0}};
    system.n_moving = wheelset_moving_states(&component->wheelset.p, system.moving);
    memcpy(system.nominal, STATE_NOMINALS, sizeof system.nominal);
    const IntegrationResult result =
        integrator_advance(&system, component->wheelset.x, duration, &component->step_sizes);
    if (result != INTEGRATION_DONE) {
        component->phase = FAILED;
        return component_fail(instance, "step from %.12g s by %g s: cannot be integrated, %s; check inputs and "
                              "parameters", time, duration, REASONS[result]);
    }
    component->time = time + duration;
    component->evaluated = 0;
    return STATUS_OK;
}
