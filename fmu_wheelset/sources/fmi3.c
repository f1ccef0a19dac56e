/* FMI 3.0 in terms of component.h. */
#include "component.h"
#include "derivatives.h"
#include "snapshot.h"

#include <fmi3Functions.h>
#include <stdlib.h>

typedef struct {
    Instance base; /* first, so that a pointer to it is a pointer to this */
    fmi3LogMessageCallback logger;
    fmi3InstanceEnvironment environment;
} Fmi3Instance;

/* Leave the calling function with an error unless the instance is in one of these phases. */
#define REQUIRE(instance, phases)                                                       \
    do {                                                                                \
        if (component_require((Instance *)(instance), (phases), __func__) != STATUS_OK) \
            return fmi3Error;                                                           \
    } while (0)

static void log_message(const Instance *instance, Status status, const char *message)
{
    const Fmi3Instance *self = (const Fmi3Instance *)instance;
    self->logger(self->environment, (fmi3Status)status,
                 status == STATUS_DISCARD ? "logStatusDiscard" : "logStatusError", message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    (void)loggingOn, (void)nCategories, (void)categories; /* errors are always logged, and there is no more */
    REQUIRE(instance, READABLE);
    return fmi3OK;
}

/* 0, with a message, if the token is not the one of this binary. */
static Fmi3Instance *instantiate(Interface interface, fmi3String instanceName, fmi3String instantiationToken,
                                 fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    if (!instanceName || !instantiationToken)
        return 0;
    Fmi3Instance *self = calloc(1, sizeof *self);
    if (!self)
        return 0;
    self->logger = logger;
    self->environment = environment;
    self->base.log = logger ? log_message : 0;
    self->base.component.interface = interface;
    component_reset(&self->base.component);
    if (component_identify(&self->base, instantiationToken, "instantiationToken") == STATUS_OK)
        return self;
    free(self);
    return 0;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
    const fmi3ValueReference requiredIntermediateVariables[], size_t nRequiredIntermediateVariables,
    fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3IntermediateUpdateCallback intermediateUpdate)
{
    (void)resourcePath, (void)visible, (void)loggingOn, (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables, (void)intermediateUpdate;
    Fmi3Instance *self = instantiate(CO_SIMULATION, instanceName, instantiationToken, instanceEnvironment, logMessage);
    if (!self || !(eventModeUsed || nRequiredIntermediateVariables > 0))
        return self;
    component_unsupported(&self->base, "fmi3InstantiateCoSimulation with event mode or intermediate variables");
    free(self);
    return 0;
}

fmi3Instance fmi3InstantiateModelExchange(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage)
{
    (void)resourcePath, (void)visible, (void)loggingOn;
    return instantiate(MODEL_EXCHANGE, instanceName, instantiationToken, instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
    fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)resourcePath, (void)visible, (void)loggingOn;
    (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
    Fmi3Instance *self = instantiate(CO_SIMULATION, instanceName, instantiationToken, instanceEnvironment, logMessage);
    if (self)
        component_unsupported(&self->base, __func__);
    free(self);
    return 0;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime)
{
    (void)toleranceDefined, (void)tolerance; /* the tolerance is fixed */
    REQUIRE(instance, INSTANTIATED);
    if (component_set_times(instance, startTime, stopTimeDefined, stopTime) != STATUS_OK)
        return fmi3Error;
    return (fmi3Status)component_enter_initialization(instance);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    REQUIRE(instance, INITIALIZATION);
    return (fmi3Status)component_exit_initialization(instance);
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    REQUIRE(instance, RUNNING);
    ((Instance *)instance)->component.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    REQUIRE(instance, READABLE);
    component_restart(instance);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint,
                      fmi3Float64 communicationStepSize, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                      fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn,
                      fmi3Float64 *lastSuccessfulTime)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    REQUIRE(instance, STEPPING);
    const Status status = component_step(instance, currentCommunicationPoint, communicationStepSize);
    if (eventHandlingNeeded)
        *eventHandlingNeeded = fmi3False;
    if (terminateSimulation)
        *terminateSimulation = fmi3False;
    if (earlyReturn)
        *earlyReturn = fmi3False;
    if (lastSuccessfulTime)
        *lastSuccessfulTime = ((Instance *)instance)->component.time;
    return (fmi3Status)status;
}

/* All variables are scalars, so that there are as many values as references. */
static Status check_arrays(Instance *instance, size_t n, const void *references, size_t nValues, const void *values)
{
    if (n != nValues)
        return component_fail(instance, "variables: got %lu values for %lu scalar variables", (unsigned long)nValues,
                              (unsigned long)n);
    return component_require_arrays(instance, n, references, values);
}

#define GET(name, type)                                                                                     \
    fmi3Status name(fmi3Instance instance, const fmi3ValueReference valueReferences[],                      \
                    size_t nValueReferences, type values[], size_t nValues)
#define SET(name, type) GET(name, const type)

GET(fmi3GetFloat64, fmi3Float64)
{
    REQUIRE(instance, READABLE);
    if (check_arrays(instance, nValueReferences, valueReferences, nValues, values) != STATUS_OK)
        return fmi3Error;
    return (fmi3Status)component_get_reals(instance, valueReferences, nValueReferences, values);
}

SET(fmi3SetFloat64, fmi3Float64)
{
    REQUIRE(instance, READABLE);
    if (check_arrays(instance, nValueReferences, valueReferences, nValues, values) != STATUS_OK)
        return fmi3Error;
    return (fmi3Status)component_set_reals(instance, valueReferences, nValueReferences, values);
}

#define GET_INTEGERS(name, type, kind)                                                                      \
    GET(name, type)                                                                                         \
    {                                                                                                       \
        REQUIRE(instance, READABLE);                                                                        \
        if (check_arrays(instance, nValueReferences, valueReferences, nValues, values) != STATUS_OK)        \
            return fmi3Error;                                                                               \
        for (size_t i = 0; i < nValues; i++) {                                                              \
            int64_t value;                                                                                  \
            if (component_get_integer(instance, kind, valueReferences[i], &value) != STATUS_OK)             \
                return fmi3Error;                                                                           \
            values[i] = (type)value;                                                                        \
        }                                                                                                   \
        return fmi3OK;                                                                                      \
    }
#define SET_INTEGERS(name, type, kind)                                                                      \
    SET(name, type)                                                                                         \
    {                                                                                                       \
        REQUIRE(instance, READABLE);                                                                        \
        if (check_arrays(instance, nValueReferences, valueReferences, nValues, values) != STATUS_OK)        \
            return fmi3Error;                                                                               \
        for (size_t i = 0; i < nValues; i++)                                                                \
            if (component_check_integer(instance, kind, valueReferences[i], values[i]) != STATUS_OK)        \
                return fmi3Error;                                                                           \
        for (size_t i = 0; i < nValues; i++)                                                                \
            component_set_integer(instance, valueReferences[i], values[i]);                                 \
        return fmi3OK;                                                                                      \
    }
GET_INTEGERS(fmi3GetInt64, fmi3Int64, ENUMERATION)
SET_INTEGERS(fmi3SetInt64, fmi3Int64, ENUMERATION)
GET_INTEGERS(fmi3GetBoolean, fmi3Boolean, BOOLEAN)
SET_INTEGERS(fmi3SetBoolean, fmi3Boolean, BOOLEAN)

/* A state is a copy of the component. */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    REQUIRE(instance, READABLE);
    return (fmi3Status)snapshot_take(instance, state);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    REQUIRE(instance, READABLE);
    return (fmi3Status)snapshot_restore(instance, state);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    REQUIRE(instance, READABLE);
    return (fmi3Status)snapshot_free(state);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    REQUIRE(instance, READABLE);
    return (fmi3Status)snapshot_size(instance, state, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    REQUIRE(instance, READABLE);
    return (fmi3Status)snapshot_write(instance, state, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    REQUIRE(instance, READABLE);
    return (fmi3Status)snapshot_read(instance, bytes, size, state);
}

#define DERIVATIVE(name, compute, nColumns, nRows)                                                          \
    fmi3Status name(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,           \
                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],            \
                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity)                           \
    {                                                                                                       \
        REQUIRE(instance, READABLE & ~INSTANTIATED);                                                        \
        const Jacobian J = {unknowns, nUnknowns, knowns, nKnowns};                                          \
        if (nSeed != (nColumns) || nSensitivity != (nRows))                                                 \
            return (fmi3Status)component_fail(instance, "derivatives: got %lu seeds and %lu sensitivities, " \
                                              "expected %lu and %lu", (unsigned long)nSeed,                 \
                                              (unsigned long)nSensitivity, (unsigned long)(nColumns),       \
                                              (unsigned long)(nRows));                                      \
        return (fmi3Status)compute(instance, &J, seed, sensitivity);                                        \
    }
DERIVATIVE(fmi3GetDirectionalDerivative, derivatives_directional, nKnowns, nUnknowns)
DERIVATIVE(fmi3GetAdjointDerivative, derivatives_adjoint, nUnknowns, nKnowns)
