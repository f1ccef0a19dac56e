/* A stiff one-step integrator for small autonomous systems: x_dot = f(x). */
#ifndef INTEGRATOR_H
#define INTEGRATOR_H

#define INTEGRATOR_MAX_STATES 8

typedef struct {
    const void *model;
    /* x_dot at x; with J != 0 also J[i][j] = d(x_dot_i)/d(x_j) in the columns of the moving states. */
    void (*evaluate)(const void *model, const double x[], double x_dot[], double J[][INTEGRATOR_MAX_STATES]);
    int n_states;
    int n_moving; /* only these states are integrated, the others are constant */
    int moving[INTEGRATOR_MAX_STATES];
    double tolerance;                       /* local error relative to the state ... */
    double nominal[INTEGRATOR_MAX_STATES];  /* ... plus this magnitude */
} OdeSystem;

typedef enum {
    INTEGRATION_DONE,
    INTEGRATION_STEP_TOO_SMALL, /* the solution is singular or not finite */
    INTEGRATION_TOO_MANY_STEPS
} IntegrationResult;

/* One step of Rodas5P with size h: x_next, and the estimated local error. Returns 0 if it is not defined. */
int integrator_step(const OdeSystem *system, const double x[], double h, double x_next[], double error[]);

/* Carried from call to call. The motion behind a jump of x_dot begins with a fast transient, the more of it the
 * larger the jump, and such jumps resemble each other: that of an input which is sampled, for example. */
typedef struct {
    double next;       /* proposed step; set it to 0 where x_dot has jumped */
    double after_jump; /* proposed first step behind a jump; 0 means unknown */
} StepSizes;

/* Advance x by `duration` > 0 with step size control. On failure x and `sizes` are left as they were. */
IntegrationResult integrator_advance(const OdeSystem *system, double x[], double duration, StepSizes *sizes);

#endif
