/* FMI 2.0 in terms of component.h. */
#include "component.h"
#include "derivatives.h"
#include "snapshot.h"

#include <fmi2Functions.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    Instance base; /* first, so that a pointer to it is a pointer to this */
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    char name[]; /* instance name */
} Fmi2Instance;

/* Leave the calling function with an error unless the instance is in one of these phases. */
#define REQUIRE(c, phases)                                                       \
    do {                                                                         \
        if (component_require((Instance *)(c), (phases), __func__) != STATUS_OK) \
            return fmi2Error;                                                    \
    } while (0)

static void log_message(const Instance *instance, Status status, const char *message)
{
    const Fmi2Instance *self = (const Fmi2Instance *)instance;
    self->logger(self->environment, self->name, (fmi2Status)status,
                 status == STATUS_DISCARD ? "logStatusDiscard" : "logStatusError", message);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[])
{
    (void)loggingOn, (void)nCategories, (void)categories; /* errors are always logged, and there is no more */
    REQUIRE(c, READABLE);
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn)
{
    (void)fmuResourceLocation, (void)visible, (void)loggingOn;
    if (!instanceName || !fmuGUID || !functions)
        return 0;
    Fmi2Instance *self = calloc(1, sizeof *self + strlen(instanceName) + 1);
    if (!self)
        return 0;
    strcpy(self->name, instanceName);
    self->logger = functions->logger;
    self->environment = functions->componentEnvironment;
    self->base.log = self->logger ? log_message : 0;
    self->base.component.interface = fmuType == fmi2ModelExchange ? MODEL_EXCHANGE : CO_SIMULATION;
    component_reset(&self->base.component);

    if (component_identify(&self->base, fmuGUID, "guid") == STATUS_OK)
        return self;
    free(self);
    return 0;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime)
{
    (void)toleranceDefined, (void)tolerance; /* the tolerance is fixed */
    REQUIRE(c, INSTANTIATED);
    return (fmi2Status)component_set_times(c, startTime, stopTimeDefined, stopTime);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    REQUIRE(c, INSTANTIATED);
    return (fmi2Status)component_enter_initialization(c);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    REQUIRE(c, INITIALIZATION);
    return (fmi2Status)component_exit_initialization(c);
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    REQUIRE(c, RUNNING);
    ((Instance *)c)->component.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    REQUIRE(c, READABLE);
    component_restart(c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[])
{
    REQUIRE(c, READABLE);
    return (fmi2Status)component_get_reals(c, vr, nvr, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[])
{
    REQUIRE(c, READABLE);
    return (fmi2Status)component_set_reals(c, vr, nvr, value);
}

static fmi2Status get_integers(Instance *instance, Kind kind, const fmi2ValueReference vr[], size_t nvr, int value[])
{
    if (component_require_arrays(instance, nvr, vr, value) != STATUS_OK)
        return fmi2Error;
    for (size_t i = 0; i < nvr; i++) {
        int64_t integer;
        if (component_get_integer(instance, kind, vr[i], &integer) != STATUS_OK)
            return fmi2Error;
        value[i] = (int)integer;
    }
    return fmi2OK;
}

static fmi2Status set_integers(Instance *instance, Kind kind, const fmi2ValueReference vr[], size_t nvr,
                               const int value[])
{
    if (component_require_arrays(instance, nvr, vr, value) != STATUS_OK)
        return fmi2Error;
    for (size_t i = 0; i < nvr; i++)
        if (component_check_integer(instance, kind, vr[i], value[i]) != STATUS_OK)
            return fmi2Error;
    for (size_t i = 0; i < nvr; i++)
        component_set_integer(instance, vr[i], value[i]);
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[])
{
    REQUIRE(c, READABLE);
    return get_integers(c, ENUMERATION, vr, nvr, value);
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[])
{
    REQUIRE(c, READABLE);
    return set_integers(c, ENUMERATION, vr, nvr, value);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[])
{
    REQUIRE(c, READABLE);
    return get_integers(c, BOOLEAN, vr, nvr, value);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[])
{
    REQUIRE(c, READABLE);
    return set_integers(c, BOOLEAN, vr, nvr, value);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    REQUIRE(c, STEPPING);
    return (fmi2Status)component_step(c, currentCommunicationPoint, communicationStepSize);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value)
{
    REQUIRE(c, STEPPING | FAILED);
    if (s != fmi2LastSuccessfulTime || !value)
        return fmi2Discard;
    *value = ((Instance *)c)->component.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value)
{
    REQUIRE(c, STEPPING | FAILED);
    if (s != fmi2Terminated || !value)
        return fmi2Discard;
    *value = fmi2False; /* only the master ends a run */
    return fmi2OK;
}

/* A state is a copy of the component. */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REQUIRE(c, READABLE);
    return (fmi2Status)snapshot_take(c, state);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    REQUIRE(c, READABLE);
    return (fmi2Status)snapshot_restore(c, state);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REQUIRE(c, READABLE);
    return (fmi2Status)snapshot_free(state);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    REQUIRE(c, READABLE);
    return (fmi2Status)snapshot_size(c, state, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    REQUIRE(c, READABLE);
    return (fmi2Status)snapshot_write(c, state, bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    REQUIRE(c, READABLE);
    return (fmi2Status)snapshot_read(c, bytes, size, state);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t nUnknown,
                                        const fmi2ValueReference knowns[], size_t nKnown, const fmi2Real seed[],
                                        fmi2Real sensitivity[])
{
    REQUIRE(c, READABLE & ~INSTANTIATED);
    const Jacobian J = {unknowns, nUnknown, knowns, nKnown};
    return (fmi2Status)derivatives_directional(c, &J, seed, sensitivity);
}

/* What modelDescription.xml does not announce. */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#define UNSUPPORTED(name, ...) \
    fmi2Status name(__VA_ARGS__) { return (fmi2Status)component_unsupported(c, #name); }
#define REFERENCES fmi2Component c, const fmi2ValueReference vr[], size_t nvr

UNSUPPORTED(fmi2GetString, REFERENCES, fmi2String value[])
UNSUPPORTED(fmi2SetString, REFERENCES, const fmi2String value[])
UNSUPPORTED(fmi2SetRealInputDerivatives, REFERENCES, const fmi2Integer order[], const fmi2Real value[])
UNSUPPORTED(fmi2GetRealOutputDerivatives, REFERENCES, const fmi2Integer order[], fmi2Real value[])
UNSUPPORTED(fmi2CancelStep, fmi2Component c)
UNSUPPORTED(fmi2GetStatus, fmi2Component c, const fmi2StatusKind s, fmi2Status *value)
UNSUPPORTED(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind s, fmi2Integer *value)
UNSUPPORTED(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind s, fmi2String *value)
