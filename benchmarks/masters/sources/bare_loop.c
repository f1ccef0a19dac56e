/* The floor: the loop that one would write by hand in C for two FMUs that are known beforehand.
 *
 * CASE is a header with the value references of both and the copying of each connection. A Jacobi exchange:
 * both FMUs step with what the other put out at the last communication point.
 */
#include <dlfcn.h>
#include <string.h>

#include "fmi2Functions.h"
#include CASE

#define EXPORT __attribute__((visibility("default")))

typedef struct {
    fmi2Component instance;
    fmi2SetRealTYPE *set;
    fmi2DoStepTYPE *step;
    fmi2GetRealTYPE *get;
    void *library;
} Fmu;

static Fmu fmus[2];
static double row[N_Y_A + N_Y_B], u_a[N_U_A], u_b[N_U_B];

static void no_log(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...) {
    (void)e; (void)name; (void)status; (void)category; (void)message;
}
static const fmi2CallbackFunctions callbacks = {no_log, NULL, NULL, NULL, NULL};

/* Load and instantiate an FMU and enter its initialisation mode; 0 if that worked. */
EXPORT int bare_open(int i, const char *library, const char *guid) {
    Fmu *fmu = &fmus[i];
    void *opened = fmu->library = dlopen(library, RTLD_NOW | RTLD_LOCAL);
    if (!opened) return 1;
    fmu->set = (fmi2SetRealTYPE *)dlsym(opened, "fmi2SetReal");
    fmu->step = (fmi2DoStepTYPE *)dlsym(opened, "fmi2DoStep");
    fmu->get = (fmi2GetRealTYPE *)dlsym(opened, "fmi2GetReal");
    fmi2InstantiateTYPE *instantiate = (fmi2InstantiateTYPE *)dlsym(opened, "fmi2Instantiate");
    fmi2SetupExperimentTYPE *set_up = (fmi2SetupExperimentTYPE *)dlsym(opened, "fmi2SetupExperiment");
    fmi2EnterInitializationModeTYPE *enter =
        (fmi2EnterInitializationModeTYPE *)dlsym(opened, "fmi2EnterInitializationMode");
    fmu->instance = instantiate("fmu", fmi2CoSimulation, guid, "", &callbacks, 0, 0);
    if (!fmu->instance) return 2;
    return set_up(fmu->instance, 0, 0.0, 0.0, 0, 0.0) != fmi2OK || enter(fmu->instance) != fmi2OK;
}

/* Leave initialisation mode. */
EXPORT int bare_start(void) {
    memset(row, 0, sizeof row);
    for (int i = 0; i < 2; i++) {
        fmi2ExitInitializationModeTYPE *leave =
            (fmi2ExitInitializationModeTYPE *)dlsym(fmus[i].library, "fmi2ExitInitializationMode");
        if (leave(fmus[i].instance) != fmi2OK) return 1;
    }
    fmus[0].get(fmus[0].instance, outputs_a, N_Y_A, row);
    fmus[1].get(fmus[1].instance, outputs_b, N_Y_B, row + N_Y_A);
    return 0;
}

static inline int exchange_and_step(double t, double h, const double *now, double *next) {
    const Fmu *a = &fmus[0], *b = &fmus[1];
    EXCHANGE(u_a, u_b, now)
    if (a->set(a->instance, inputs_a, N_U_A, u_a) > fmi2Warning) return 1;
    if (a->step(a->instance, t, h, fmi2True) > fmi2Warning) return 1;
    if (a->get(a->instance, outputs_a, N_Y_A, next) > fmi2Warning) return 1;
    if (b->set(b->instance, inputs_b, N_U_B, u_b) > fmi2Warning) return 1;
    if (b->step(b->instance, t, h, fmi2True) > fmi2Warning) return 1;
    return b->get(b->instance, outputs_b, N_Y_B, next + N_Y_A) > fmi2Warning;
}

/* Make n steps and keep nothing but the last values; 0 if all FMUs went along. */
EXPORT int bare_run(long n, double h) {
    for (long k = 0; k < n; k++) {
        if (exchange_and_step(k * h, h, row, row)) return 1;
    }
    return 0;
}

/* Make n steps; rows has n + 1, times as many numbers. */
EXPORT int bare_record(long n, double h, double *times, double *rows) {
    times[0] = 0.0;
    memcpy(rows, row, sizeof row);
    for (long k = 0; k < n; k++, rows += N_Y_A + N_Y_B) {
        if (exchange_and_step(k * h, h, rows, rows + N_Y_A + N_Y_B)) return 1;
        times[k + 1] = (k + 1) * h;
    }
    return 0;
}

EXPORT void bare_close(void) {
    for (int i = 0; i < 2; i++) {
        fmi2TerminateTYPE *terminate = (fmi2TerminateTYPE *)dlsym(fmus[i].library, "fmi2Terminate");
        fmi2FreeInstanceTYPE *release = (fmi2FreeInstanceTYPE *)dlsym(fmus[i].library, "fmi2FreeInstance");
        terminate(fmus[i].instance);
        release(fmus[i].instance);
        dlclose(fmus[i].library);
    }
}
