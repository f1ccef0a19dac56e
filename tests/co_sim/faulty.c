/* An FMU that misbehaves as its instance name says, such as "segfault_in_step"; for FMI 2 and FMI 3.
 *
 * Its output 0 is a lag of its input 1, its parameter 2 the step that goes wrong. Before it misbehaves, it says so
 * in its log and on the standard output. Any other name is that of a healthy instance.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING };
enum { Y, U, AT };

typedef struct {
    double x, u;
    int step, at;
    char name[64];
    fmi2CallbackFunctions callbacks;
    fmi3LogMessageCallback log3;
    void *environment;
} Faulty;

static void say(Faulty *f, int status, const char *text) {
    if (f->log3) f->log3(f->environment, status, "faults", text);
    else f->callbacks.logger(f->environment, f->name, status, "faults", "%s", text);
}

/* What is kept here cannot be optimised away. */
static void *volatile kept;

static void allocate(Faulty *f, bool surrender) {
    size_t size = 4 << 20;
    for (;;) {
        char *memory = kept = malloc(size);
        if (!memory) {
            say(f, ERROR, "no memory left");
            if (surrender) abort();
        } else {
            memset(memory, 1, size);
        }
    }
}

static void hang(void) {
    for (volatile int i = 0;; i++) {}
}

/* Does what the name asks for in this place; returns a status. */
static int misbehave(Faulty *f, const char *place) {
    char fault[64], text[160];
    const char *in = strstr(f->name, "_in_");
    if (!in || strcmp(in + 4, place) != 0) return OK;
    snprintf(fault, sizeof fault, "%.*s", (int)(in - f->name), f->name);
    snprintf(text, sizeof text, "now comes %s in %s", fault, place);
    say(f, OK, text);
    printf("printed: %s\n", text);
    if (!strcmp(fault, "segfault")) { volatile uintptr_t nowhere = 16; *(volatile int *)nowhere = 1; }
    if (!strcmp(fault, "abort")) abort();
    if (!strcmp(fault, "exit")) exit(3);
    if (!strcmp(fault, "exit0")) exit(0);
    if (!strcmp(fault, "hang")) hang();
    if (!strcmp(fault, "allocate")) allocate(f, true);
    if (!strcmp(fault, "insist")) allocate(f, false);
    if (!strcmp(fault, "flood")) for (int i = 0; i < 20000; i++) printf("line %d of many, none of which matters\n", i);
    if (!strcmp(fault, "endless")) for (;;) printf("an endless line of words ");
    if (!strcmp(fault, "logs")) for (int i = 0; i < 5000; i++) say(f, WARNING, "the same message again");
    if (!strcmp(fault, "nan")) f->x = NAN;
    if (!strcmp(fault, "inf")) f->x = INFINITY;
    if (!strcmp(fault, "warning")) return WARNING;
    if (!strcmp(fault, "discard")) return DISCARD;
    if (!strcmp(fault, "error")) return ERROR;
    if (!strcmp(fault, "fatal")) return FATAL;
    if (!strcmp(fault, "pending")) return PENDING;
    return OK;
}

static Faulty *create(const char *name, const fmi2CallbackFunctions *callbacks, fmi3LogMessageCallback log3,
                      void *environment) {
    Faulty *f = calloc(1, sizeof(Faulty));
    if (!f) return NULL;
    snprintf(f->name, sizeof f->name, "%s", name);
    if (callbacks) f->callbacks = *callbacks;
    f->log3 = log3;
    f->environment = environment;
    f->at = 5;
    if (misbehave(f, "instantiate") <= WARNING) return f;
    free(f);
    return NULL;
}

static int advance(Faulty *f, double h) {
    f->x += (f->u - f->x) * -expm1(-h);
    return f->step++ == f->at ? misbehave(f, "step") : OK;
}

static void destroy(Faulty *f) {
    misbehave(f, "free");
    free(f);
}

/* FMI 2 */

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const fmi2CallbackFunctions *callbacks, int visible, int logging) {
    (void)type; (void)guid; (void)resources; (void)visible; (void)logging;
    return create(name, callbacks, NULL, callbacks->componentEnvironment);
}
EXPORT void fmi2FreeInstance(void *c) { destroy(c); }
EXPORT int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double t0, int has_stop, double stop) {
    (void)has_tolerance; (void)tolerance; (void)t0; (void)has_stop; (void)stop;
    return misbehave(c, "setup");
}
EXPORT int fmi2EnterInitializationMode(void *c) { return misbehave(c, "enter"); }
EXPORT int fmi2ExitInitializationMode(void *c) { return misbehave(c, "initialise"); }
EXPORT int fmi2Terminate(void *c) { return misbehave(c, "terminate"); }
EXPORT int fmi2GetReal(void *c, const unsigned r[], size_t n, double v[]) {
    Faulty *f = c;
    if (f->step == 0) misbehave(f, "get");
    for (size_t i = 0; i < n; i++) v[i] = r[i] == Y ? f->x : f->u;
    return OK;
}
EXPORT int fmi2SetReal(void *c, const unsigned r[], size_t n, const double v[]) {
    for (size_t i = 0; i < n; i++) ((Faulty *)c)->u = r[i] == U ? v[i] : 0.0;
    return OK;
}
EXPORT int fmi2SetInteger(void *c, const unsigned r[], size_t n, const int v[]) {
    for (size_t i = 0; i < n; i++) ((Faulty *)c)->at = r[i] == AT ? v[i] : 0;
    return OK;
}
EXPORT int fmi2DoStep(void *c, double t, double h, int never_back) {
    (void)t; (void)never_back;
    return advance(c, h);
}

/* FMI 3 */

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool events, bool early_return, const unsigned required[],
                                         size_t n_required, void *environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)token; (void)resources; (void)visible; (void)logging; (void)events; (void)early_return;
    (void)required; (void)n_required; (void)update;
    return create(name, NULL, log, environment);
}
EXPORT void fmi3FreeInstance(void *c) { destroy(c); }
EXPORT int fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double t0, bool has_stop,
                                       double stop) {
    (void)has_tolerance; (void)tolerance; (void)t0; (void)has_stop; (void)stop;
    return misbehave(c, "enter");
}
EXPORT int fmi3ExitInitializationMode(void *c) { return misbehave(c, "initialise"); }
EXPORT int fmi3Terminate(void *c) { return misbehave(c, "terminate"); }
EXPORT int fmi3GetFloat64(void *c, const unsigned r[], size_t n, double v[], size_t n_values) {
    return n == n_values ? fmi2GetReal(c, r, n, v) : ERROR;
}
EXPORT int fmi3SetFloat64(void *c, const unsigned r[], size_t n, const double v[], size_t n_values) {
    return n == n_values ? fmi2SetReal(c, r, n, v) : ERROR;
}
EXPORT int fmi3SetInt32(void *c, const unsigned r[], size_t n, const int v[], size_t n_values) {
    return n == n_values ? fmi2SetInteger(c, r, n, v) : ERROR;
}
EXPORT int fmi3DoStep(void *c, double t, double h, bool never_back, bool *event, bool *terminate, bool *early,
                      double *last) {
    (void)never_back;
    *event = *terminate = *early = false;
    *last = t + h;
    return advance(c, h);
}

/* The rest of both interfaces must be there for fmpy to load the library. */

#define STUB(name) EXPORT int name(void); EXPORT int name(void) { return ERROR; }
#include STUBS
