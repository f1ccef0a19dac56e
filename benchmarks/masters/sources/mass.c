/* A mass on a spring, pushed to and fro, as an FMI 2 co-simulation FMU of little cost.
 *
 *     m x'' = +-p - k x - d x' + f
 *
 * Built with -DCOUPLED=0, f is an input and the motion x, x' is the output. With -DCOUPLED=1 the mass brings
 * the spring to its neighbour: x_n, x_n' are the inputs, the force on the neighbour is an output, and
 * f = -force. Euler's method takes SUBSTEPS internal steps for each communication step. The push p changes its sign every second; all outputs are zero at the start, so that masters
 * that pass no values before the first step compute the same as those that do.
 */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#define EXPORT __attribute__((visibility("default")))

enum { DISPLACEMENT, VELOCITY, FORCE, NEIGHBOUR_DISPLACEMENT, NEIGHBOUR_VELOCITY, PUSHED_BY, N_VALUES };

typedef struct {
    double value[N_VALUES];
    double time;
} Mass;

__attribute__((used)) static fmi2Status stub(void) { return fmi2Error; }

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                                     fmi2Boolean logging) {
    (void)name; (void)resources; (void)callbacks; (void)visible; (void)logging;
    return type == fmi2CoSimulation && strcmp(guid, GUID) == 0 ? calloc(1, sizeof(Mass)) : NULL;
}

EXPORT void fmi2FreeInstance(fmi2Component c) { free(c); }

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real v[]) {
    Mass *mass = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= N_VALUES) return fmi2Error;
        mass->value[r[i]] = v[i];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real v[]) {
    Mass *mass = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] >= N_VALUES) return fmi2Error;
        v[i] = mass->value[r[i]];
    }
    return fmi2OK;
}

static double coupling_force(const double *value) {
    return COUPLING_STIFFNESS * (value[DISPLACEMENT] - value[NEIGHBOUR_DISPLACEMENT])
         + COUPLING_DAMPING * (value[VELOCITY] - value[NEIGHBOUR_VELOCITY]);
}

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean never_back) {
    (void)t; (void)never_back;
    Mass *mass = c;
    double *value = mass->value;
    double push = (long)(mass->time + 0.5 * h) % 2 ? -PUSH : PUSH;
    double internal = h / SUBSTEPS;
    for (int i = 0; i < SUBSTEPS; i++) {
        double f = COUPLED ? -coupling_force(value) : value[PUSHED_BY];
        double sum = push - STIFFNESS * value[DISPLACEMENT] - DAMPING * value[VELOCITY] + f;
        value[VELOCITY] += internal * sum / MASS;
        value[DISPLACEMENT] += internal * value[VELOCITY];
    }
    if (COUPLED) value[FORCE] = coupling_force(value);
    mass->time += h;
    return fmi2OK;
}

EXPORT const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
EXPORT const char *fmi2GetVersion(void) { return fmi2Version; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c; (void)on; (void)n; (void)categories;
    return fmi2OK;
}
EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real t0,
                                      fmi2Boolean has_stop, fmi2Real stop) {
    (void)has_tolerance; (void)tolerance; (void)has_stop; (void)stop;
    ((Mass *)c)->time = t0;
    return fmi2OK;
}
EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Terminate(fmi2Component c) { (void)c; return fmi2OK; }
EXPORT fmi2Status fmi2Reset(fmi2Component c) {
    memset(c, 0, sizeof(Mass));
    return fmi2OK;
}

/* Importing tools look for all functions of the standard; what this FMU does not offer fails. */
#define STUB(name) EXPORT name##TYPE name __attribute__((alias("stub")));
STUB(fmi2GetInteger) STUB(fmi2GetBoolean) STUB(fmi2GetString)
STUB(fmi2SetInteger) STUB(fmi2SetBoolean) STUB(fmi2SetString)
STUB(fmi2GetFMUstate) STUB(fmi2SetFMUstate) STUB(fmi2FreeFMUstate)
STUB(fmi2SerializedFMUstateSize) STUB(fmi2SerializeFMUstate) STUB(fmi2DeSerializeFMUstate)
STUB(fmi2GetDirectionalDerivative) STUB(fmi2SetRealInputDerivatives) STUB(fmi2GetRealOutputDerivatives)
STUB(fmi2CancelStep) STUB(fmi2GetStatus) STUB(fmi2GetRealStatus) STUB(fmi2GetIntegerStatus)
STUB(fmi2GetBooleanStatus) STUB(fmi2GetStringStatus)
