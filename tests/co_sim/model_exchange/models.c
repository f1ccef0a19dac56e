/* Small models for Model Exchange of FMI 2 and FMI 3, chosen by the token; a strict referee of the calls.
 *
 * oscillator: x'' = -w^2 x + u; the output "total" is x + u.
 * ball:       h'' = -g, bounces with restitution e; counts its bounces.
 * counter:    no states; counts at each multiple of `period`, where it also samples the discrete input d,
 *             and notes how often d was set; ends the simulation at the count `limit`. At each event it shows its
 *             count as an integer, tripled by the input `flag`, and copies the text `word` to `echo`.
 * saw:        x' = 1; asks for an event after the integration step that brings x to 1 or more, then x is 1 less.
 * relay:      x' = 1 below and -1 above x = u, where it chatters; its events need two iterations.
 *
 * Calls in a wrong mode, times that go back behind an event, and inputs set where the standard forbids it are errors.
 * `trouble` makes the derivatives from that time on an error; with `endless` no event ever settles.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

enum { OSCILLATOR, BALL, COUNTER, SAW, RELAY };
enum { OK, WARNING, DISCARD, ERROR };
enum { INSTANTIATED = 1, INITIALISING = 2, EVENT = 4, CONTINUOUS = 8, ENDED = 16 };
enum { X, V, DX, DV, U, D, TOTAL, COUNT, SAMPLE, SETTINGS, P1, P2, P3, TROUBLE, ENDLESS, N_VALUES };
enum { FLAG = 20, LEVEL, WORD, ECHO };

static const char *const NAMES[] = {"oscillator", "ball", "counter", "saw", "relay"};
static const unsigned N_STATES[] = {2, 2, 0, 1, 1}, N_INDICATORS[] = {0, 1, 0, 0, 1};

typedef struct {
    double value[N_VALUES], time, event_time, next, mode_of_relay;
    int model, mode, iterations, flag, level;
    char word[16], echo[16];
} State;

typedef struct {
    State state;
    const fmi2CallbackFunctions *callbacks2;
    fmi3LogMessageCallback log3;
    void *environment3;
} Instance;

static int complain(Instance *self, const char *text) {
    if (self->callbacks2)
        self->callbacks2->logger(self->callbacks2->componentEnvironment, "exchange", ERROR, "log", "%s", text);
    else
        self->log3(self->environment3, ERROR, "log", text);
    return ERROR;
}

#define REQUIRE(c, modes)                                                                          \
    do {                                                                                           \
        if (!(((Instance *)(c))->state.mode & (modes))) return complain(c, __func__);              \
    } while (0)

static void evaluate(State *s) {
    double *v = s->value;
    switch (s->model) {
        case OSCILLATOR:
            v[DX] = v[V];
            v[DV] = -v[P1] * v[P1] * v[X] + v[U];
            v[TOTAL] = v[X] + v[U];
            break;
        case BALL:
            v[DX] = v[V];
            v[DV] = -9.81;
            break;
        case SAW: v[DX] = 1.0; break;
        case RELAY: v[DX] = s->mode_of_relay; break;
        default: break;
    }
}

static void start(State *s) {
    double *v = s->value;
    v[X] = v[P2];
    v[V] = s->model == OSCILLATOR ? v[P3] : 0.0;
    s->next = s->model == COUNTER ? v[P1] : INFINITY;
    s->mode_of_relay = -1.0;
    s->event_time = s->time;
    s->mode = EVENT;
}

/* One iteration of an event; returns whether states have changed. */
static int handle(State *s, int *again, int *end) {
    double *v = s->value;
    int changed = 0;
    *again = v[ENDLESS] != 0.0;
    *end = 0;
    if (s->model == BALL && v[X] <= 0.0 && v[V] < 0.0) {
        v[X] = DBL_MIN;
        v[V] = -v[P1] * v[V];
        v[COUNT] += 1.0;
        changed = 1;
    } else if (s->model == COUNTER && s->time >= s->next) {
        v[COUNT] += 1.0;
        v[SAMPLE] = v[D];
        s->next = v[P1] * (v[COUNT] + 1.0);
        *end = v[COUNT] == v[P3];
    } else if (s->model == SAW && v[X] >= 1.0) {
        v[X] -= 1.0;
        v[COUNT] += 1.0;
        changed = 1;
    } else if (s->model == RELAY) {
        double side = v[X] > v[U] ? -1.0 : 1.0;
        if (side != s->mode_of_relay) {
            s->mode_of_relay = side;
            v[COUNT] += 1.0;
            *again = 1;
        }
    }
    s->level = (int)v[COUNT] * (s->flag ? 3 : 1);
    memcpy(s->echo, s->word, sizeof s->echo);
    s->iterations++;
    return changed;
}

static double indicator(const State *s) { return s->model == BALL ? s->value[X] : s->value[X] - s->value[U]; }

static int get(Instance *self, const unsigned r[], size_t n, double v[]) {
    REQUIRE(self, INITIALISING | EVENT | CONTINUOUS);
    evaluate(&self->state);
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= N_VALUES) return complain(self, "unknown variable");
        v[i] = self->state.value[r[i]];
        if (self->state.mode == INITIALISING && r[i] == X) v[i] = self->state.value[P2];
    }
    return OK;
}

static int set(Instance *self, const unsigned r[], size_t n, const double v[]) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] == U)
            REQUIRE(self, INITIALISING | EVENT | CONTINUOUS);
        else if (r[i] == D)
            REQUIRE(self, INITIALISING | EVENT);
        else if (r[i] >= P1 && r[i] < N_VALUES)
            REQUIRE(self, INSTANTIATED | INITIALISING);
        else
            return complain(self, "unknown variable");
        if (r[i] == D) self->state.value[SETTINGS] += 1.0;
        self->state.value[r[i]] = v[i];
    }
    return OK;
}

static int set_flag(Instance *self, unsigned r, int value) {
    REQUIRE(self, INITIALISING | EVENT);
    if (r != FLAG) return complain(self, "unknown variable");
    self->state.flag = value;
    return OK;
}

static int get_level(Instance *self, unsigned r, int *value) {
    if (r != LEVEL) return complain(self, "unknown variable");
    *value = self->state.level;
    return OK;
}

static int set_word(Instance *self, unsigned r, const char *value) {
    REQUIRE(self, INITIALISING | EVENT);
    if (r != WORD) return complain(self, "unknown variable");
    snprintf(self->state.word, sizeof self->state.word, "%s", value);
    return OK;
}

static int get_echo(Instance *self, unsigned r, const char **value) {
    if (r != ECHO) return complain(self, "unknown variable");
    *value = self->state.echo;
    return OK;
}

static Instance *create(const char *token) {
    Instance *self = calloc(1, sizeof *self);
    for (int i = 0; i < 5; i++)
        if (strcmp(token, NAMES[i]) == 0) self->state.model = i;
    self->state.mode = INSTANTIATED;
    self->state.value[TROUBLE] = INFINITY;
    return self;
}

/* What both versions call by the same name and with the same arguments. */

#define BOTH(name, arguments, values)                                     \
    static int name arguments;                                            \
    EXPORT int fmi2##name arguments;                                      \
    EXPORT int fmi3##name arguments;                                      \
    EXPORT int fmi2##name arguments { return name values; }               \
    EXPORT int fmi3##name arguments { return name values; }               \
    static int name arguments

BOTH(ExitInitializationMode, (void *c), (c)) {
    REQUIRE(c, INITIALISING);
    start(&((Instance *)c)->state);
    return OK;
}
BOTH(Terminate, (void *c), (c)) {
    REQUIRE(c, EVENT | CONTINUOUS);
    ((Instance *)c)->state.mode = ENDED;
    return OK;
}
BOTH(EnterEventMode, (void *c), (c)) {
    State *s = &((Instance *)c)->state;
    REQUIRE(c, CONTINUOUS);
    s->mode = EVENT;
    s->event_time = s->time;
    s->iterations = 0;
    return OK;
}
BOTH(EnterContinuousTimeMode, (void *c), (c)) {
    REQUIRE(c, EVENT);
    ((Instance *)c)->state.mode = CONTINUOUS;
    return OK;
}
BOTH(SetTime, (void *c, double t), (c, t)) {
    Instance *self = c;
    REQUIRE(c, CONTINUOUS);
    if (t < self->state.event_time) return complain(c, "the time went back behind an event");
    if (t > self->state.next) return complain(c, "a time event was missed");
    self->state.time = t;
    return OK;
}
BOTH(SetContinuousStates, (void *c, const double x[], size_t n), (c, x, n)) {
    Instance *self = c;
    REQUIRE(c, CONTINUOUS);
    if (n != N_STATES[self->state.model]) return complain(c, "wrong number of states");
    memcpy(self->state.value, x, n * sizeof *x);
    return OK;
}
BOTH(GetContinuousStates, (void *c, double x[], size_t n), (c, x, n)) {
    Instance *self = c;
    REQUIRE(c, EVENT | CONTINUOUS);
    memcpy(x, self->state.value, n * sizeof *x);
    return OK;
}
BOTH(GetNominalsOfContinuousStates, (void *c, double x[], size_t n), (c, x, n)) {
    REQUIRE(c, EVENT | CONTINUOUS);
    for (size_t i = 0; i < n; i++) x[i] = 2.0;
    return OK;
}
static int derivatives(void *c, double dx[], size_t n) {
    Instance *self = c;
    REQUIRE(c, EVENT | CONTINUOUS);
    if (self->state.time >= self->state.value[TROUBLE]) return complain(c, "the model is in trouble");
    evaluate(&self->state);
    memcpy(dx, &self->state.value[DX], n * sizeof *dx);
    return OK;
}
EXPORT int fmi2GetDerivatives(void *c, double dx[], size_t n) { return derivatives(c, dx, n); }
EXPORT int fmi3GetContinuousStateDerivatives(void *c, double dx[], size_t n) { return derivatives(c, dx, n); }
BOTH(GetEventIndicators, (void *c, double z[], size_t n), (c, z, n)) {
    Instance *self = c;
    REQUIRE(c, EVENT | CONTINUOUS);
    if (n != N_INDICATORS[self->state.model]) return complain(c, "wrong number of indicators");
    z[0] = indicator(&self->state);
    return OK;
}
static int complete(Instance *self, int *event) {
    REQUIRE(self, CONTINUOUS);
    self->state.event_time = self->state.time;
    *event = self->state.model == SAW && self->state.value[X] >= 1.0;
    return OK;
}
EXPORT int fmi2CompletedIntegratorStep(void *c, int never_back, int *event, int *end) {
    (void)never_back;
    *end = 0;
    return complete(c, event);
}
EXPORT int fmi3CompletedIntegratorStep(void *c, bool never_back, bool *event, bool *end) {
    (void)never_back;
    int wanted = 0, status = complete(c, &wanted);
    *event = wanted;
    *end = false;
    return status;
}

/* States of the FMU: `time` may go back with them. */

static int get_state(void *c, void **state) {
    if (!*state) *state = malloc(sizeof(State));
    **(State **)state = ((Instance *)c)->state;
    return OK;
}
static int set_state(void *c, void *state) {
    ((Instance *)c)->state = *(State *)state;
    return OK;
}
static int free_state(void **state) {
    free(*state);
    *state = NULL;
    return OK;
}
EXPORT int fmi2GetFMUstate(void *c, void **state) { return get_state(c, state); }
EXPORT int fmi3GetFMUState(void *c, void **state) { return get_state(c, state); }
EXPORT int fmi2SetFMUstate(void *c, void *state) { return set_state(c, state); }
EXPORT int fmi3SetFMUState(void *c, void *state) { return set_state(c, state); }
EXPORT int fmi2FreeFMUstate(void *c, void **state) { (void)c; return free_state(state); }
EXPORT int fmi3FreeFMUState(void *c, void **state) { (void)c; return free_state(state); }
static int state_size(size_t *size) {
    *size = sizeof(State);
    return OK;
}
EXPORT int fmi2SerializedFMUstateSize(void *c, void *s, size_t *n) { (void)c; (void)s; return state_size(n); }
EXPORT int fmi3SerializedFMUStateSize(void *c, void *s, size_t *n) { (void)c; (void)s; return state_size(n); }
static int write_state(const void *state, unsigned char bytes[], size_t n) {
    memcpy(bytes, state, n);
    return OK;
}
static int read_state(const unsigned char bytes[], size_t n, void **state) {
    *state = malloc(n);
    memcpy(*state, bytes, n);
    return OK;
}
EXPORT int fmi2SerializeFMUstate(void *c, void *s, unsigned char b[], size_t n) { (void)c; return write_state(s, b, n); }
EXPORT int fmi3SerializeFMUState(void *c, void *s, unsigned char b[], size_t n) { (void)c; return write_state(s, b, n); }
EXPORT int fmi2DeSerializeFMUstate(void *c, const unsigned char b[], size_t n, void **s) {
    (void)c; return read_state(b, n, s);
}
EXPORT int fmi3DeserializeFMUState(void *c, const unsigned char b[], size_t n, void **s) {
    (void)c; return read_state(b, n, s);
}

/* FMI 2 */

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT void *fmi2Instantiate(const char *name, int kind, const char *token, const char *resources,
                             const fmi2CallbackFunctions *callbacks, int visible, int logging) {
    (void)name; (void)resources; (void)visible; (void)logging;
    if (kind != fmi2ModelExchange) return NULL;
    Instance *self = create(token);
    self->callbacks2 = callbacks;
    return self;
}
EXPORT void fmi2FreeInstance(void *c) { free(c); }
EXPORT int fmi2SetupExperiment(void *c, int has_tolerance, double tolerance, double t0, int has_stop, double stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    ((Instance *)c)->state.time = t0;
    return OK;
}
EXPORT int fmi2EnterInitializationMode(void *c) {
    REQUIRE(c, INSTANTIATED);
    ((Instance *)c)->state.mode = INITIALISING;
    return OK;
}
EXPORT int fmi2GetReal(void *c, const unsigned r[], size_t n, double v[]) { return get(c, r, n, v); }
EXPORT int fmi2SetReal(void *c, const unsigned r[], size_t n, const double v[]) { return set(c, r, n, v); }
EXPORT int fmi2SetBoolean(void *c, const unsigned r[], size_t n, const int v[]) {
    return n == 1 ? set_flag(c, r[0], v[0]) : ERROR;
}
EXPORT int fmi2GetInteger(void *c, const unsigned r[], size_t n, int v[]) {
    return n == 1 ? get_level(c, r[0], v) : ERROR;
}
EXPORT int fmi2SetString(void *c, const unsigned r[], size_t n, const char *const v[]) {
    return n == 1 ? set_word(c, r[0], v[0]) : ERROR;
}
EXPORT int fmi2GetString(void *c, const unsigned r[], size_t n, const char *v[]) {
    return n == 1 ? get_echo(c, r[0], v) : ERROR;
}
EXPORT int fmi2NewDiscreteStates(void *c, fmi2EventInfo *info) {
    REQUIRE(c, EVENT);
    State *s = &((Instance *)c)->state;
    info->nominalsOfContinuousStatesChanged = 0;
    info->valuesOfContinuousStatesChanged = handle(s, &info->newDiscreteStatesNeeded, &info->terminateSimulation);
    info->nextEventTimeDefined = isfinite(s->next);
    info->nextEventTime = s->next;
    return OK;
}

/* FMI 3 */

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                          bool logging, void *environment, fmi3LogMessageCallback log) {
    (void)name; (void)resources; (void)visible; (void)logging;
    Instance *self = create(token);
    self->log3 = log;
    self->environment3 = environment;
    return self;
}
EXPORT void fmi3FreeInstance(void *c) { free(c); }
EXPORT int fmi3EnterInitializationMode(void *c, bool has_tolerance, double tolerance, double t0, bool has_stop,
                                       double stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    ((Instance *)c)->state.time = t0;
    return fmi2EnterInitializationMode(c);
}
EXPORT int fmi3GetNumberOfContinuousStates(void *c, size_t *n) {
    *n = N_STATES[((Instance *)c)->state.model];
    return OK;
}
EXPORT int fmi3GetNumberOfEventIndicators(void *c, size_t *n) {
    *n = N_INDICATORS[((Instance *)c)->state.model];
    return OK;
}
EXPORT int fmi3GetFloat64(void *c, const unsigned r[], size_t n, double v[], size_t n_values) {
    return n == n_values ? get(c, r, n, v) : ERROR;
}
EXPORT int fmi3SetFloat64(void *c, const unsigned r[], size_t n, const double v[], size_t n_values) {
    return n == n_values ? set(c, r, n, v) : ERROR;
}
EXPORT int fmi3SetBoolean(void *c, const unsigned r[], size_t n, const bool v[], size_t n_values) {
    return n == 1 && n_values == 1 ? set_flag(c, r[0], v[0]) : ERROR;
}
EXPORT int fmi3GetInt32(void *c, const unsigned r[], size_t n, int v[], size_t n_values) {
    return n == 1 && n_values == 1 ? get_level(c, r[0], v) : ERROR;
}
EXPORT int fmi3SetString(void *c, const unsigned r[], size_t n, const char *const v[], size_t n_values) {
    return n == 1 && n_values == 1 ? set_word(c, r[0], v[0]) : ERROR;
}
EXPORT int fmi3GetString(void *c, const unsigned r[], size_t n, const char *v[], size_t n_values) {
    return n == 1 && n_values == 1 ? get_echo(c, r[0], v) : ERROR;
}
EXPORT int fmi3UpdateDiscreteStates(void *c, bool *again, bool *end, bool *nominals, bool *values, bool *timed,
                                    double *next) {
    REQUIRE(c, EVENT);
    State *s = &((Instance *)c)->state;
    int needed = 0, over = 0;
    *values = handle(s, &needed, &over);
    *again = needed;
    *end = over;
    *nominals = false;
    *timed = isfinite(s->next);
    *next = s->next;
    return OK;
}

/* The rest of both interfaces must be there for fmpy to load the library. */

#define STUB(name) EXPORT int name(void); EXPORT int name(void) { return ERROR; }
#include STUBS
