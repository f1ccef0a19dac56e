/* What fmu_step.py times, in loops of C.
 *
 * component.c is included, not linked, for its right-hand side and the settings of its integrator. The loops
 * receive the functions of the FMUs and of CVode as pointers, and read instances of our FMU as `Instance`, for
 * they are made from the same sources. */
#include "component.c"

#include <fmi3Functions.h>

#define EXPORT __attribute__((visibility("default")))

typedef fmi3SetFloat64TYPE *SetReals;

/* n communication steps, each with a new track offset unless `offsets` is 0. Returns how many succeeded. */
EXPORT int steps(fmi3DoStepTYPE *do_step, SetReals set, fmi3Instance instance, double t0, double h, int n,
                 fmi3ValueReference reference, const double offsets[])
{
    fmi3Boolean event, terminate, early;
    double reached;
    for (int k = 0; k < n; k++) {
        if (offsets && set(instance, &reference, 1, &offsets[k], 1) != fmi3OK)
            return k;
        if (do_step(instance, t0 + k * h, h, fmi3True, &event, &terminate, &early, &reached) != fmi3OK)
            return k;
    }
    return n;
}

/* x_dot at each of n states, `times` times, with its Jacobian if `jacobian`; the last x_dot remains. */
EXPORT void evaluations(const Instance *instance, double x[][N_STATES], int n, int times, int jacobian,
                        double x_dot[])
{
    double J[N_STATES][N_STATES];
    for (int k = 0; k < n * times; k++)
        evaluate_states(&instance->component.wheelset, x[k % n], x_dot, jacobian ? J : 0);
}

static long counted[2];

static void evaluate_counted(const void *model, const double x[], double x_dot[], double J[][N_STATES])
{
    counted[J != 0]++;
    evaluate_states(model, x, x_dot, J);
}

/* Evaluations without and with Jacobian of the next step; the instance stays as it is. */
EXPORT void count_evaluations(const Instance *instance, double h, long counts[2])
{
    Component component = instance->component;
    OdeSystem system = {&component.wheelset, evaluate_counted, N_STATES, 0, {0}, TOLERANCE, {0}};
    system.n_moving = wheelset_moving_states(&component.wheelset.p, system.moving);
    memcpy(system.nominal, STATE_NOMINALS, sizeof system.nominal);
    counted[0] = counted[1] = 0;
    integrator_advance(&system, component.wheelset.x, h, &component.step_sizes);
    counts[0] += counted[0];
    counts[1] += counted[1];
}

/* CVode in C: the functions of the FMU that its right-hand side calls, and those of CVode. */
typedef struct {
    fmi3Instance instance;
    fmi3SetTimeTYPE *set_time;
    fmi3SetContinuousStatesTYPE *set_states;
    fmi3GetContinuousStateDerivativesTYPE *get_derivatives;
    SetReals set_reals;
    double *(*data)(void *vector);
    int (*cvode)(void *memory, double t, void *x, double *reached, int task);
    int (*restart)(void *memory, double t, void *x);
    long evaluations;
} Exchange;

EXPORT Exchange exchange;

EXPORT int exchange_derivatives(double t, void *x, void *x_dot, void *unused)
{
    (void)unused;
    exchange.evaluations++;
    exchange.set_time(exchange.instance, t);
    exchange.set_states(exchange.instance, exchange.data(x), N_STATES);
    return exchange.get_derivatives(exchange.instance, exchange.data(x_dot), N_STATES) != fmi3OK;
}

/* As steps; a new offset restarts CVode. */
EXPORT int steps_cvode(void *memory, void *x, double t0, double h, int n, fmi3ValueReference reference,
                       const double offsets[])
{
    enum { NORMAL = 1 };
    double reached;
    for (int k = 0; k < n; k++) {
        if (offsets && (exchange.set_reals(exchange.instance, &reference, 1, &offsets[k], 1) != fmi3OK
                        || exchange.restart(memory, t0 + k * h, x) != 0))
            return k;
        if (exchange.cvode(memory, t0 + (k + 1) * h, x, &reached, NORMAL) < 0)
            return k;
    }
    return n;
}
