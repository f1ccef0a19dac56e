/* A first-order lag T*dx/dt + x = gain*u as FMI 2 and FMI 3 FMU, solved exactly for a held input.
 *
 * Output 0 is x, output 1 is gain*u (direct feed-through). Every type of parameter is there to be set:
 * T and x0 (float), trouble_step (integer: the step that misbehaves), trouble (enumeration: the status it
 * returns), negative (boolean: reverses the gain), label (text: goes into the log).
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

enum { X, DIRECT, U, T, X0, TROUBLE_STEP, TROUBLE, NEGATIVE, LABEL };
enum { OK, WARNING, DISCARD, ERROR, FATAL, TERMINATE };

typedef struct {
    double x, u, T, x0, stop;
    int step, trouble_step, trouble, negative, initialised, worst;
    char label[64];
    const fmi2CallbackFunctions *callbacks2;
    fmi3LogMessageCallback log3;
    void *environment3;
} Lag;

static Lag *create(void) {
    Lag *lag = calloc(1, sizeof(Lag));
    if (lag) {
        lag->T = 1.0;
        lag->stop = INFINITY;
        lag->trouble_step = -1;
    }
    return lag;
}

static double feed(const Lag *lag) { return lag->negative ? -lag->u : lag->u; }

static int get(const Lag *lag, unsigned reference, double *value) {
    switch (reference) {
        case X: *value = lag->initialised ? lag->x : lag->x0; return OK;
        case DIRECT: *value = feed(lag); return OK;
        case T: *value = lag->T; return OK;
        default: return ERROR;
    }
}

static int set(Lag *lag, unsigned reference, double value) {
    switch (reference) {
        case U: lag->u = value; return OK;
        case T: lag->T = value; return OK;
        case X0: lag->x0 = value; return OK;
        default: return ERROR;
    }
}

static int set_integer(Lag *lag, unsigned reference, int value) {
    switch (reference) {
        case TROUBLE_STEP: lag->trouble_step = value; return OK;
        case TROUBLE: lag->trouble = value; return OK;
        case NEGATIVE: lag->negative = value; return OK;
        default: return ERROR;
    }
}

static int set_text(Lag *lag, unsigned reference, const char *value) {
    if (reference != LABEL) return ERROR;
    snprintf(lag->label, sizeof lag->label, "%s", value);
    return OK;
}

static void initialise(Lag *lag) {
    lag->x = lag->x0;
    lag->initialised = 1;
}

static int advance(Lag *lag, double h) {
    if (!lag->initialised) return ERROR;
    lag->x += (feed(lag) - lag->x) * -expm1(-h / lag->T);
    int status = lag->step++ == lag->trouble_step ? lag->trouble : OK;
    if (status != TERMINATE && status > lag->worst) lag->worst = status;
    return status;
}

/* Neither standard allows to terminate after an error, nor to free after a fatal one. */

static int terminate(const Lag *lag) { return lag->initialised && lag->worst < ERROR ? OK : ERROR; }

static void destroy(Lag *lag) {
    if (lag->worst == FATAL) abort();
    free(lag);
}

/* FMI 2 */

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const fmi2CallbackFunctions *callbacks, int visible, int logging) {
    (void)type; (void)resources; (void)visible; (void)logging;
    if (strcmp(guid, "lag") != 0) {
        callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "log", "wrong token %s", guid);
        return NULL;
    }
    Lag *lag = create();
    if (lag) lag->callbacks2 = callbacks;
    return lag;
}
EXPORT void fmi2FreeInstance(void *c) { destroy(c); }
EXPORT int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double t0, int has_stop, double stop) {
    (void)has_tolerance; (void)tolerance; (void)t0;
    if (has_stop) ((Lag *)c)->stop = stop;
    return OK;
}
EXPORT int fmi2EnterInitializationMode(void *c) { (void)c; return OK; }
EXPORT int fmi2ExitInitializationMode(void *c) { initialise(c); return OK; }
EXPORT int fmi2Terminate(void *c) { return terminate(c); }
EXPORT int fmi2GetReal(void *c, const unsigned r[], size_t n, double v[]) {
    int status = OK;
    for (size_t i = 0; i < n; i++) status |= get(c, r[i], &v[i]);
    return status;
}
EXPORT int fmi2SetReal(void *c, const unsigned r[], size_t n, const double v[]) {
    int status = OK;
    for (size_t i = 0; i < n; i++) status |= set(c, r[i], v[i]);
    return status;
}
EXPORT int fmi2SetInteger(void *c, const unsigned r[], size_t n, const int v[]) {
    int status = OK;
    for (size_t i = 0; i < n; i++) status |= set_integer(c, r[i], v[i]);
    return status;
}
EXPORT int fmi2SetBoolean(void *c, const unsigned r[], size_t n, const int v[]) {
    return fmi2SetInteger(c, r, n, v);
}
EXPORT int fmi2SetString(void *c, const unsigned r[], size_t n, const char *const v[]) {
    int status = OK;
    for (size_t i = 0; i < n; i++) status |= set_text(c, r[i], v[i]);
    return status;
}
EXPORT int fmi2DoStep(void *c, double t, double h, int never_back) {
    (void)never_back;
    Lag *lag = c;
    /* Without a tolerance for rounding, as simple exporters do it. */
    if (t + h > lag->stop) return ERROR;
    int status = advance(lag, h);
    if (status != OK) {
        lag->callbacks2->logger(lag->callbacks2->componentEnvironment, "lag", status, "log",
                                "%s had trouble in step %d", lag->label, lag->trouble_step);
    }
    return status == TERMINATE ? DISCARD : status;
}

/* FMI 3 */

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool events, bool early_return, const unsigned required[],
                                         size_t n_required, void *environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name; (void)resources; (void)visible; (void)logging; (void)events; (void)early_return;
    (void)required; (void)n_required; (void)update;
    if (strcmp(token, "lag") != 0) {
        log(environment, fmi3Error, "log", "wrong token x");
        return NULL;
    }
    Lag *lag = create();
    if (lag) {
        lag->log3 = log;
        lag->environment3 = environment;
    }
    return lag;
}
EXPORT void fmi3FreeInstance(void *c) { destroy(c); }
EXPORT int fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double t0, bool has_stop,
                                       double stop) {
    return fmi2SetupExperiment(c, has_tolerance, tolerance, t0, has_stop, stop);
}
EXPORT int fmi3ExitInitializationMode(void *c) { initialise(c); return OK; }
EXPORT int fmi3Terminate(void *c) { return terminate(c); }
EXPORT int fmi3GetFloat64(void *c, const unsigned r[], size_t n, double v[], size_t n_values) {
    return n == n_values ? fmi2GetReal(c, r, n, v) : ERROR;
}
EXPORT int fmi3SetFloat64(void *c, const unsigned r[], size_t n, const double v[], size_t n_values) {
    return n == n_values ? fmi2SetReal(c, r, n, v) : ERROR;
}
EXPORT int fmi3SetInt32(void *c, const unsigned r[], size_t n, const int v[], size_t n_values) {
    return n == n_values ? fmi2SetInteger(c, r, n, v) : ERROR;
}
EXPORT int fmi3SetInt64(void *c, const unsigned r[], size_t n, const long long v[], size_t n_values) {
    int status = n == n_values ? OK : ERROR;
    for (size_t i = 0; i < n; i++) status |= set_integer(c, r[i], (int)v[i]);
    return status;
}
EXPORT int fmi3SetBoolean(void *c, const unsigned r[], size_t n, const bool v[], size_t n_values) {
    int status = n == n_values ? OK : ERROR;
    for (size_t i = 0; i < n; i++) status |= set_integer(c, r[i], v[i]);
    return status;
}
EXPORT int fmi3SetString(void *c, const unsigned r[], size_t n, const char *const v[], size_t n_values) {
    return n == n_values ? fmi2SetString(c, r, n, v) : ERROR;
}
EXPORT int fmi3DoStep(void *c, double t, double h, bool never_back, bool *event, bool *terminate, bool *early,
                      double *last) {
    (void)never_back;
    Lag *lag = c;
    if (t + h > lag->stop) return ERROR;
    int status = advance(lag, h);
    *event = *early = false;
    *terminate = status == TERMINATE;
    *last = t + h;
    if (status != OK) {
        char message[128];
        snprintf(message, sizeof message, "%s had trouble in step %d", lag->label, lag->trouble_step);
        lag->log3(lag->environment3, status == TERMINATE ? OK : status, "log", message);
    }
    return status == TERMINATE ? OK : status;
}

/* The rest of both interfaces must be there for fmpy to load the library. */

#define STUB(name) EXPORT int name(void); EXPORT int name(void) { return ERROR; }
#include STUBS
