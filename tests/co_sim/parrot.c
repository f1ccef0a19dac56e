/* An FMU with ports of every type: each output is its input plus the number of steps done.
 *
 * Inputs have the references 0 to 12 and outputs 20 to 32, in the order of the kinds below; booleans turn over
 * with each step, enumerations are echoed, texts end in the number of steps, and 64-bit integers have an offset
 * more. Arrays: a (2 by 2, doubled), v (n elements, reversed), texts. The state `sum` integrates float64_in with the
 * derivatives that were set. `trouble` is the status that the call `trouble_in` returns from the second step on.
 */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#define EXPORT __attribute__((visibility("default")))

enum { OK, WARNING, DISCARD, ERROR };
enum { NEVER, IN_SET, IN_STEP, IN_GET, EARLY };
enum { MOST = 8, LENGTH = 32 };

typedef struct {
    double f64; float f32;
    int8_t i8; uint8_t u8; int16_t i16; uint16_t u16; int32_t i32; uint32_t u32; int64_t i64; uint64_t u64;
    int32_t boolean; int64_t enumeration; char text[LENGTH];
    double a[4]; int32_t v[MOST]; char texts[2][LENGTH];
} Values;

typedef struct {
    Values in, out;
    double sum, slopes[2], gains[4];
    uint64_t n;
    int64_t offset;
    int32_t trouble, trouble_in, count, stepping, never_back, order, configured, states;
} Parrot;

static void refresh(Parrot *p) {
    Values *y = &p->out;
    const Values *u = &p->in;
    int k = p->count;
    y->f64 = u->f64 + k; y->f32 = u->f32 + (float)k;
    y->i8 = (int8_t)(u->i8 + k); y->u8 = (uint8_t)(u->u8 + k);
    y->i16 = (int16_t)(u->i16 + k); y->u16 = (uint16_t)(u->u16 + k);
    y->i32 = (int32_t)((uint32_t)u->i32 + (uint32_t)k); y->u32 = u->u32 + (uint32_t)k;
    y->i64 = (int64_t)((uint64_t)u->i64 + (uint64_t)k + (uint64_t)p->offset);
    y->u64 = u->u64 + (uint64_t)k + (uint64_t)p->offset;
    y->boolean = u->boolean ^ (k & 1);
    y->enumeration = u->enumeration;
    snprintf(y->text, LENGTH, "%.20s%d", u->text, k);
    for (int i = 0; i < 4; i++) y->a[i] = p->gains[i] * u->a[i] + k;
    for (uint64_t i = 0; i < p->n; i++) y->v[i] = u->v[p->n - 1 - i] + k;
    for (int i = 0; i < 2; i++) snprintf(y->texts[i], LENGTH, "%.20s%d", u->texts[1 - i], k);
}

static void *find(Parrot *p, unsigned reference, size_t *size) {
    Values *side = reference < 20 ? &p->in : &p->out;
    *size = 1;
    switch (reference) {
        case 0: case 20: return &side->f64;
        case 1: case 21: return &side->f32;
        case 2: case 22: return &side->i8;
        case 3: case 23: return &side->u8;
        case 4: case 24: return &side->i16;
        case 5: case 25: return &side->u16;
        case 6: case 26: return &side->i32;
        case 7: case 27: return &side->u32;
        case 8: case 28: return &side->i64;
        case 9: case 29: return &side->u64;
        case 10: case 30: return &side->boolean;
        case 11: case 31: return &side->enumeration;
        case 12: case 32: return side->text;
        case 13: case 33: *size = 4; return side->a;
        case 14: case 34: *size = p->n; return side->v;
        case 15: case 35: *size = 2; return side->texts;
        case 40: return &p->n;
        case 41: return &p->offset;
        case 42: return &p->trouble;
        case 43: return &p->trouble_in;
        case 44: *size = 4; return p->gains;
        case 60: return &p->sum;
        case 61: return &p->states;
        case 62: return &p->never_back;
        case 63: return &p->order;
        case 64: return &p->in.f64;
        default: return NULL;
    }
}

static int status_of(const Parrot *p, int call) {
    int has_trouble = p->stepping && p->count >= (call == IN_GET ? 2 : 1) && p->trouble_in == call;
    return has_trouble ? p->trouble : OK;
}

/* Typed access; the number of values must be that of the elements. */

#define SET(FUNCTION, C_TYPE, STORED)                                                                   \
    static int FUNCTION(Parrot *p, const unsigned r[], size_t n, const C_TYPE v[], size_t n_values) {   \
        size_t used = 0, size;                                                                          \
        for (size_t i = 0; i < n; i++) {                                                                \
            STORED *place = find(p, r[i], &size);                                                       \
            if (!place || used + size > n_values) return ERROR;                                         \
            for (size_t k = 0; k < size; k++) place[k] = (STORED)v[used++];                             \
        }                                                                                               \
        refresh(p);                                                                                     \
        return used == n_values ? status_of(p, IN_SET) : ERROR;                                         \
    }
#define GET(FUNCTION, C_TYPE, STORED)                                                                   \
    static int FUNCTION(Parrot *p, const unsigned r[], size_t n, C_TYPE v[], size_t n_values) {         \
        size_t used = 0, size;                                                                          \
        for (size_t i = 0; i < n; i++) {                                                                \
            STORED *place = find(p, r[i], &size);                                                       \
            if (!place || used + size > n_values) return ERROR;                                         \
            for (size_t k = 0; k < size; k++) v[used++] = (C_TYPE)place[k];                             \
        }                                                                                               \
        return used == n_values ? status_of(p, IN_GET) : ERROR;                                         \
    }
#define ACCESS(SETTER, GETTER, NAME, C_TYPE, STORED)                                                                    \
    SET(set_##NAME, C_TYPE, STORED)                                                                     \
    GET(get_##NAME, C_TYPE, STORED)                                                                     \
    EXPORT int SETTER(void *c, const unsigned r[], size_t n, const C_TYPE v[], size_t n_values) {  \
        return set_##NAME(c, r, n, v, n_values);                                                        \
    }                                                                                                   \
    EXPORT int GETTER(void *c, const unsigned r[], size_t n, C_TYPE v[], size_t n_values) {      \
        return get_##NAME(c, r, n, v, n_values);                                                        \
    }

ACCESS(fmi3SetFloat64, fmi3GetFloat64, Float64, double, double)
ACCESS(fmi3SetFloat32, fmi3GetFloat32, Float32, float, float)
ACCESS(fmi3SetInt8, fmi3GetInt8, Int8, int8_t, int8_t)
ACCESS(fmi3SetUInt8, fmi3GetUInt8, UInt8, uint8_t, uint8_t)
ACCESS(fmi3SetInt16, fmi3GetInt16, Int16, int16_t, int16_t)
ACCESS(fmi3SetUInt16, fmi3GetUInt16, UInt16, uint16_t, uint16_t)
ACCESS(fmi3SetInt32, fmi3GetInt32, Int32, int32_t, int32_t)
ACCESS(fmi3SetUInt32, fmi3GetUInt32, UInt32, uint32_t, uint32_t)
ACCESS(fmi3SetInt64, fmi3GetInt64, Int64, int64_t, int64_t)
ACCESS(fmi3SetUInt64, fmi3GetUInt64, UInt64, uint64_t, uint64_t)
ACCESS(fmi3SetBoolean, fmi3GetBoolean, Boolean, bool, int32_t)

EXPORT int fmi3SetString(void *c, const unsigned r[], size_t n, const char *const v[], size_t n_values) {
    size_t used = 0, size;
    for (size_t i = 0; i < n; i++) {
        char *place = find(c, r[i], &size);
        if (!place || used + size > n_values) return ERROR;
        for (size_t k = 0; k < size; k++) snprintf(place + k * LENGTH, LENGTH, "%s", v[used++]);
    }
    refresh(c);
    return OK;
}
EXPORT int fmi3GetString(void *c, const unsigned r[], size_t n, const char *v[], size_t n_values) {
    size_t used = 0, size;
    for (size_t i = 0; i < n; i++) {
        char *place = find(c, r[i], &size);
        if (!place || used + size > n_values) return ERROR;
        for (size_t k = 0; k < size; k++) v[used++] = place + k * LENGTH;
    }
    return OK;
}

static Parrot *create(void) {
    Parrot *p = calloc(1, sizeof(Parrot));
    if (p) {
        p->n = 2;
        for (int i = 0; i < 4; i++) p->gains[i] = 2.0;
        refresh(p);
    }
    return p;
}

static int advance(Parrot *p, double h, int never_back) {
    int status = status_of(p, IN_STEP);
    if (!p->stepping) return ERROR;
    p->sum += h * (p->in.f64 + h * (p->slopes[0] / 2.0 + h * p->slopes[1] / 6.0));
    p->count++;
    p->never_back = never_back;
    refresh(p);
    return status;
}

static int differentiate(const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[], size_t n_knowns,
                         const double seed[], double result[]) {
    for (size_t i = 0; i < n_unknowns; i++) {
        result[i] = 0.0;
        for (size_t k = 0; k < n_knowns; k++) {
            if (knowns[k] == 0 && (unknowns[i] == 64 || unknowns[i] == 20)) result[i] += seed[k];
            if (knowns[k] == 60 && unknowns[i] == 60) result[i] += seed[k];
        }
    }
    return OK;
}

/* States: whole copies. How many there are belongs to the instance. */

static int save(Parrot *p, void **state) {
    if (!*state) {
        *state = malloc(sizeof(Parrot));
        p->states++;
    }
    memcpy(*state, p, sizeof(Parrot));
    return OK;
}
static int restore(Parrot *p, const void *state) {
    int states = p->states;
    memcpy(p, state, sizeof(Parrot));
    p->states = states;
    return OK;
}
static int drop(Parrot *p, void **state) {
    free(*state);
    *state = NULL;
    p->states--;
    return OK;
}

/* Versions. */

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const fmi2CallbackFunctions *callbacks, int visible, int logging) {
    (void)name; (void)type; (void)guid; (void)resources; (void)callbacks; (void)visible; (void)logging;
    return create();
}
EXPORT void fmi2FreeInstance(void *c) {
    /* Whoever closes an instance must have freed its states. */
    if (((Parrot *)c)->states) abort();
    free(c);
}
EXPORT int fmi2SetupExperiment(void *c, int a, double b, double t0, int d, double e) {
    (void)c; (void)a; (void)b; (void)t0; (void)d; (void)e;
    return OK;
}
EXPORT int fmi2EnterInitializationMode(void *c) { (void)c; return OK; }
EXPORT int fmi2ExitInitializationMode(void *c) { ((Parrot *)c)->stepping = 1; return OK; }
EXPORT int fmi2Terminate(void *c) { (void)c; return OK; }
EXPORT int fmi2SetReal(void *c, const unsigned r[], size_t n, const double v[]) {
    return set_Float64(c, r, n, v, n);
}
EXPORT int fmi2GetReal(void *c, const unsigned r[], size_t n, double v[]) { return get_Float64(c, r, n, v, n); }

static size_t is_enumeration(unsigned reference) { return reference == 11 || reference == 31; }

EXPORT int fmi2SetInteger(void *c, const unsigned r[], size_t n, const int v[]) {
    int status = OK;
    for (size_t i = 0; i < n; i++) {
        int64_t wide = v[i];
        status |= is_enumeration(r[i]) ? set_Int64(c, &r[i], 1, &wide, 1) : set_Int32(c, &r[i], 1, &v[i], 1);
    }
    return status;
}
EXPORT int fmi2GetInteger(void *c, const unsigned r[], size_t n, int v[]) {
    int status = OK;
    for (size_t i = 0; i < n; i++) {
        int64_t wide = 0;
        status |= is_enumeration(r[i]) ? get_Int64(c, &r[i], 1, &wide, 1) : get_Int32(c, &r[i], 1, &v[i], 1);
        if (is_enumeration(r[i])) v[i] = (int)wide;
    }
    return status;
}
EXPORT int fmi2SetBoolean(void *c, const unsigned r[], size_t n, const int v[]) {
    return set_Int32(c, r, n, v, n);
}
EXPORT int fmi2GetBoolean(void *c, const unsigned r[], size_t n, int v[]) { return get_Int32(c, r, n, v, n); }
EXPORT int fmi2SetString(void *c, const unsigned r[], size_t n, const char *const v[]) {
    return fmi3SetString(c, r, n, v, n);
}
EXPORT int fmi2GetString(void *c, const unsigned r[], size_t n, const char *v[]) {
    return fmi3GetString(c, r, n, v, n);
}
EXPORT int fmi2SetRealInputDerivatives(void *c, const unsigned r[], size_t n, const int order[], const double v[]) {
    Parrot *p = c;
    p->order = 0;
    for (size_t i = 0; i < n; i++) {
        if (r[i] != 0 || order[i] < 1 || order[i] > 2) return ERROR;
        p->slopes[order[i] - 1] = v[i];
        if (order[i] > p->order) p->order = order[i];
    }
    return OK;
}
EXPORT int fmi2DoStep(void *c, double t, double h, int never_back) { (void)t; return advance(c, h, never_back); }
EXPORT int fmi2GetFMUstate(void *c, void **state) { return save(c, state); }
EXPORT int fmi2SetFMUstate(void *c, void *state) { return restore(c, state); }
EXPORT int fmi2FreeFMUstate(void *c, void **state) { return drop(c, state); }
EXPORT int fmi2SerializedFMUstateSize(void *c, void *state, size_t *size) {
    (void)c; (void)state;
    *size = sizeof(Parrot);
    return OK;
}
EXPORT int fmi2SerializeFMUstate(void *c, void *state, char bytes[], size_t size) {
    (void)c;
    memcpy(bytes, state, size);
    return OK;
}
EXPORT int fmi2DeSerializeFMUstate(void *c, const char bytes[], size_t size, void **state) {
    if (size != sizeof(Parrot)) return ERROR;
    save(c, state);
    memcpy(*state, bytes, size);
    return OK;
}
EXPORT int fmi2GetDirectionalDerivative(void *c, const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[],
                                        size_t n_knowns, const double seed[], double result[]) {
    (void)c;
    return differentiate(unknowns, n_unknowns, knowns, n_knowns, seed, result);
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool events, bool early_return, const unsigned required[],
                                         size_t n_required, void *environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)events; (void)early_return;
    (void)required; (void)n_required; (void)environment; (void)log; (void)update;
    return create();
}
EXPORT void fmi3FreeInstance(void *c) { fmi2FreeInstance(c); }
EXPORT int fmi3EnterConfigurationMode(void *c) { ((Parrot *)c)->configured = 1; return OK; }
EXPORT int fmi3ExitConfigurationMode(void *c) { return ((Parrot *)c)->n <= MOST ? OK : ERROR; }
EXPORT int fmi3EnterInitializationMode(void *c, bool a, double b, double t0, bool d, double e) {
    (void)a; (void)b; (void)t0; (void)d; (void)e;
    Parrot *p = c;
    return p->n == 2 || p->configured ? OK : ERROR;
}
EXPORT int fmi3ExitInitializationMode(void *c) { return fmi2ExitInitializationMode(c); }
EXPORT int fmi3Terminate(void *c) { (void)c; return OK; }
EXPORT int fmi3DoStep(void *c, double t, double h, bool never_back, bool *event, bool *terminate, bool *early,
                      double *last) {
    Parrot *p = c;
    *event = true; /* means nothing without event mode */
    *terminate = false;
    *early = p->trouble_in == EARLY && p->count >= 1;
    *last = t + h / 2.0;
    return advance(p, h, never_back);
}
EXPORT int fmi3GetFMUState(void *c, void **state) { return save(c, state); }
EXPORT int fmi3SetFMUState(void *c, void *state) { return restore(c, state); }
EXPORT int fmi3FreeFMUState(void *c, void **state) { return drop(c, state); }
EXPORT int fmi3SerializedFMUStateSize(void *c, void *state, size_t *size) {
    return fmi2SerializedFMUstateSize(c, state, size);
}
EXPORT int fmi3SerializeFMUState(void *c, void *state, uint8_t bytes[], size_t size) {
    return fmi2SerializeFMUstate(c, state, (char *)bytes, size);
}
EXPORT int fmi3DeserializeFMUState(void *c, const uint8_t bytes[], size_t size, void **state) {
    return fmi2DeSerializeFMUstate(c, (const char *)bytes, size, state);
}
EXPORT int fmi3GetDirectionalDerivative(void *c, const unsigned unknowns[], size_t n_unknowns, const unsigned knowns[],
                                        size_t n_knowns, const double seed[], size_t n_seed, double result[],
                                        size_t n_result) {
    (void)c;
    if (n_seed != n_knowns || n_result != n_unknowns) return ERROR;
    return differentiate(unknowns, n_unknowns, knowns, n_knowns, seed, result);
}

/* The rest of both interfaces must be there for fmpy to load the library. */

#define STUB(name) EXPORT int name(void); EXPORT int name(void) { return ERROR; }
#include STUBS
