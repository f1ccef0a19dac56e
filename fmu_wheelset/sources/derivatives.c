#include "derivatives.h"

#include <string.h>

static int is_state(const Variable *variable)
{
    const size_t first = offsetof(Component, wheelset.x);
    return variable->offset >= first && variable->offset < first + N_STATES * sizeof(double);
}

/* Until the run begins, states without start value follow from the inputs. */
static int is_known(const Component *component, const Variable *variable)
{
    if (is_state(variable))
        return variable->source == STORED || !(component->phase & STARTING);
    return variable->settable == ALWAYS;
}

static Status check_references(Instance *instance, const Jacobian *J)
{
    for (size_t j = 0; j < J->n_knowns; j++) {
        const Variable *known = component_find(instance, J->knowns[j], FLOAT64);
        if (!known)
            return STATUS_ERROR;
        if (!is_known(&instance->component, known))
            return component_fail(instance, "%s: got it as a known of a derivative, expected an input or a state "
                                  "that is set", known->name);
    }
    for (size_t i = 0; i < J->n_unknowns; i++) {
        const Variable *unknown = component_find(instance, J->unknowns[i], FLOAT64);
        if (!unknown)
            return STATUS_ERROR;
        if (unknown->source == STORED && !is_state(unknown))
            return component_fail(instance, "%s: got it as an unknown of a derivative, expected a state derivative "
                                  "or an output", unknown->name);
    }
    return STATUS_OK;
}

/* References, and the numbers that go with them. */
static Status check(Instance *instance, const Jacobian *J, const double of_knowns[], const double of_unknowns[])
{
    if (component_require_arrays(instance, J->n_knowns, J->knowns, of_knowns) != STATUS_OK
        || component_require_arrays(instance, J->n_unknowns, J->unknowns, of_unknowns) != STATUS_OK)
        return STATUS_ERROR;
    return check_references(instance, J);
}

/* `d` is a direction in the space of components: it holds seeds where a component holds inputs and states, and
 * receives the derivatives of all that is computed from them. */
static void differentiate(Component *component, const Evaluation *e, Component *d)
{
    const Wheelset *wheelset = &component->wheelset;
    Evaluation d_e;
    if (component->phase & STARTING)
        wheelset_initialise_tangent(wheelset, &d->wheelset.u, d->wheelset.x);
    wheelset_tangent(wheelset, wheelset->x, e, d->wheelset.x, &d->wheelset.u, &d_e);
    wheelset_outputs_tangent(wheelset, e, d->wheelset.x, &d->wheelset.u, &d_e, &d->outputs);
    memcpy(d->x_dot, d_e.x_dot, sizeof d->x_dot);
    for (int i = LEFT; i <= RIGHT; i++)
        if (component->peak_known[i])
            d->peak[i] = contact_peak_tangent(&wheelset->p.patch, &component->peak_at[i], &component->peak[i],
                                              &d_e.at[i]);
}

/* The point at which derivatives are taken, with the peaks that the unknowns need. */
static void evaluate(Component *component, const Jacobian *J, Evaluation *e)
{
    component_prepare(component, EVALUATED);
    for (size_t i = 0; i < J->n_unknowns; i++)
        component_prepare(component, component_variable(J->unknowns[i])->source);
    wheelset_evaluate(&component->wheelset, component->wheelset.x, e);
}

static double *entry(Component *d, uint32_t reference)
{
    return component_location(d, component_variable(reference));
}

static Status check_sensitivity(Instance *instance, uint32_t reference, double value)
{
    return component_check_finite(instance, component_variable(reference)->name, value);
}

Status derivatives_directional(Instance *instance, const Jacobian *J, const double seed[], double sensitivity[])
{
    if (check(instance, J, seed, sensitivity) != STATUS_OK)
        return STATUS_ERROR;
    Evaluation e;
    Component d;
    memset(&d, 0, sizeof d);
    evaluate(&instance->component, J, &e);
    for (size_t j = 0; j < J->n_knowns; j++)
        *entry(&d, J->knowns[j]) += seed[j];
    differentiate(&instance->component, &e, &d);
    for (size_t i = 0; i < J->n_unknowns; i++) {
        sensitivity[i] = *entry(&d, J->unknowns[i]);
        if (check_sensitivity(instance, J->unknowns[i], sensitivity[i]) != STATUS_OK)
            return STATUS_DISCARD;
    }
    return STATUS_OK;
}

/* By columns of the Jacobian: there are about as many unknowns as knowns, and a column is cheap. */
Status derivatives_adjoint(Instance *instance, const Jacobian *J, const double seed[], double sensitivity[])
{
    if (check(instance, J, sensitivity, seed) != STATUS_OK)
        return STATUS_ERROR;
    Evaluation e;
    evaluate(&instance->component, J, &e);
    for (size_t j = 0; j < J->n_knowns; j++) {
        Component d;
        memset(&d, 0, sizeof d);
        *entry(&d, J->knowns[j]) = 1.0;
        differentiate(&instance->component, &e, &d);
        sensitivity[j] = 0.0;
        for (size_t i = 0; i < J->n_unknowns; i++)
            sensitivity[j] += seed[i] * *entry(&d, J->unknowns[i]);
        if (check_sensitivity(instance, J->knowns[j], sensitivity[j]) != STATUS_OK)
            return STATUS_DISCARD;
    }
    return STATUS_OK;
}
