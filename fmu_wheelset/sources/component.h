/* One wheelset as a simulation component: memory, life cycle, variables by reference, and steps.
 *
 * The FMI adapters translate to and from this interface; the physics below it does not know of either. */
#ifndef COMPONENT_H
#define COMPONENT_H

#include "integrator.h"
#include "wheelset.h"

#include <stddef.h>
#include <stdint.h>

/* In the order of the FMI standards. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR, STATUS_FATAL } Status;

typedef enum { CO_SIMULATION, MODEL_EXCHANGE } Interface;

/* Bits, so that a function can name all phases in which it is allowed. */
typedef enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    STEPPING = 4,    /* co-simulation */
    EVENT = 8,       /* model exchange */
    CONTINUOUS = 16, /* model exchange */
    TERMINATED = 32,
    FAILED = 64, /* a step had no solution: read, reset or free */
    STARTING = INSTANTIATED | INITIALIZATION,
    RUNNING = STEPPING | EVENT | CONTINUOUS,
    READABLE = STARTING | RUNNING | TERMINATED | FAILED
} Phase;

typedef enum { FLOAT64, ENUMERATION, BOOLEAN } Kind;
typedef enum { READ_ONLY, BEFORE_RUN, ALWAYS } Settable;
/* What must be computed before a variable can be read. */
typedef enum { STORED, EVALUATED, PEAK_LEFT, PEAK_RIGHT } Source;

typedef struct {
    const char *name;
    Kind kind;
    Settable settable;
    Source source;
    size_t offset; /* in Component */
    double start, minimum, maximum;
} Variable;

/* No pointers: a copy of the bytes is a copy of the state. */
typedef struct {
    int32_t interface;
    int32_t phase;
    int32_t evaluated; /* x_dot and outputs belong to the present states and inputs */
    int32_t peak_known[2];
    int32_t stop_time_defined;
    double time, stop_time;
    StepSizes step_sizes;
    Wheelset wheelset;
    double x_dot[N_STATES];
    Outputs outputs;
    ContactPeak peak[2];
    ContactState peak_at[2]; /* what the peaks belong to */
} Component;

typedef struct Instance Instance;
struct Instance {
    Component component;
    Component start; /* what a restart returns to */
    void (*log)(const Instance *instance, Status status, const char *message); /* may be 0 */
};

extern const char *const INSTANTIATION_TOKEN;

/* STATUS_ERROR with a message unless the instance exists and is in one of `phases`. */
Status component_require(Instance *instance, int phases, const char *function);
Status component_fail(Instance *instance, const char *format, ...);
Status component_unsupported(Instance *instance, const char *function);

/* STATUS_DISCARD: the call was right, but at the present states the model has no value. */
Status component_discard(Instance *instance, const char *format, ...);
Status component_check_finite(Instance *instance, const char *what, double value);

/* The start values of the table. */
void component_reset(Component *component);

/* Accept the token of modelDescription.xml (token.c), `attribute` there, with the start values that it carries. */
Status component_identify(Instance *instance, const char *token, const char *attribute);
Status component_set_start(Instance *instance, uint32_t reference, double value);

/* Back to the start values that the instance was identified with. */
void component_restart(Instance *instance);
Status component_set_times(Instance *instance, double start_time, int stop_time_defined, double stop_time);
Status component_enter_initialization(Instance *instance);
Status component_exit_initialization(Instance *instance);

/* Advance from `time` to `time + duration`; on failure the states stay as they were. */
Status component_step(Instance *instance, double time, double duration);

/* STATUS_ERROR with a message if an array of n > 0 elements is missing. */
Status component_require_arrays(Instance *instance, size_t n, const void *references, const void *values);

/* All values are checked before the first one is set. */
Status component_get_reals(Instance *instance, const uint32_t references[], size_t n, double values[]);
Status component_set_reals(Instance *instance, const uint32_t references[], size_t n, const double values[]);
Status component_get_integer(Instance *instance, Kind kind, uint32_t reference, int64_t *value);
Status component_check_integer(Instance *instance, Kind kind, uint32_t reference, int64_t value);
void component_set_integer(Instance *instance, uint32_t reference, int64_t value); /* that was checked */

/* Parts for the modules beside this one: the table, and what it points to. */
const Variable *component_variable(uint32_t reference); /* of a reference that was found */
const Variable *component_find(Instance *instance, uint32_t reference, Kind kind);
void *component_location(Component *component, const Variable *variable);
void component_prepare(Component *component, Source source);
extern const double *const COMPONENT_NOMINALS; /* of the states */

#endif
