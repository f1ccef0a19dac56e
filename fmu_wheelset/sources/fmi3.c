/* FMI 3.0 in terms of component.h. */
#include "component.h"
#include "derivatives.h"
#include "snapshot.h"

#include <fmi3Functions.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    Instance base; /* first, so that a pointer to it is a pointer to this */
    fmi3LogMessageCallback logger;
    fmi3InstanceEnvironment environment;
} Fmi3Instance;

/* Leave the calling function with an error unless the instance is in one of these phases. */
#define REQUIRE(instance, phases)                                                    \
    do {                                                                             \
        if (component_require((Instance *)(instance), (phases), __func__) != STATUS_OK) \
            return fmi3Error;                                                        \
    } while (0)

static void log_message(const Instance *instance, Status status, const char *message)
{
    const Fmi3Instance *self = (const Fmi3Instance *)instance;
    self->logger(self->environment, (fmi3Status)status, "logStatusError", message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[])
{
    (void)loggingOn, (void)nCategories, (void)categories; /* errors are always logged, and there is no more */
    REQUIRE(instance, READABLE);
    return fmi3OK;
}

static Fmi3Instance *allocate(fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    Fmi3Instance *self = calloc(1, sizeof *self);
    if (!self)
        return 0;
    self->logger = logger;
    self->environment = environment;
    self->base.log = logger ? log_message : 0;
    component_reset(&self->base.component);
    return self;
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
    if (!instanceName || !instantiationToken)
        return 0;
    Fmi3Instance *self = allocate(instanceEnvironment, logMessage);
    if (!self)
        return 0;

    if (eventModeUsed || nRequiredIntermediateVariables > 0)
        component_unsupported(&self->base, "fmi3InstantiateCoSimulation with event mode or intermediate variables");
    else if (strcmp(instantiationToken, INSTANTIATION_TOKEN) != 0)
        component_fail(&self->base, "instantiationToken: got another than %s, so modelDescription.xml and binary "
                       "do not belong together; install the FMU again", INSTANTIATION_TOKEN);
    else
        return self;
    free(self);
    return 0;
}

fmi3Instance fmi3InstantiateModelExchange(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage)
{
    (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible, (void)loggingOn;
    Fmi3Instance *self = allocate(instanceEnvironment, logMessage);
    if (self)
        component_unsupported(&self->base, __func__);
    free(self);
    return 0;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
    fmi3UnlockPreemptionCallback unlockPreemption)
{
    (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible, (void)loggingOn;
    (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
    Fmi3Instance *self = allocate(instanceEnvironment, logMessage);
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
    REQUIRE(instance, STEPPING);
    ((Instance *)instance)->component.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    REQUIRE(instance, READABLE);
    component_reset(&((Instance *)instance)->component);
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
            if (component_set_integer(instance, kind, valueReferences[i], values[i]) != STATUS_OK)          \
                return fmi3Error;                                                                           \
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

/* What modelDescription.xml does not announce. */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#define UNSUPPORTED(name, ...) \
    fmi3Status name(__VA_ARGS__) { return (fmi3Status)component_unsupported(instance, #name); }
#define UNSUPPORTED_GET(name, type) GET(name, type) { return (fmi3Status)component_unsupported(instance, #name); }
#define UNSUPPORTED_SET(name, type) SET(name, type) { return (fmi3Status)component_unsupported(instance, #name); }
#define REFERENCES fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences

UNSUPPORTED_GET(fmi3GetFloat32, fmi3Float32)
UNSUPPORTED_GET(fmi3GetInt8, fmi3Int8)
UNSUPPORTED_GET(fmi3GetUInt8, fmi3UInt8)
UNSUPPORTED_GET(fmi3GetInt16, fmi3Int16)
UNSUPPORTED_GET(fmi3GetUInt16, fmi3UInt16)
UNSUPPORTED_GET(fmi3GetInt32, fmi3Int32)
UNSUPPORTED_GET(fmi3GetUInt32, fmi3UInt32)
UNSUPPORTED_GET(fmi3GetUInt64, fmi3UInt64)
UNSUPPORTED_GET(fmi3GetString, fmi3String)
UNSUPPORTED_SET(fmi3SetFloat32, fmi3Float32)
UNSUPPORTED_SET(fmi3SetInt8, fmi3Int8)
UNSUPPORTED_SET(fmi3SetUInt8, fmi3UInt8)
UNSUPPORTED_SET(fmi3SetInt16, fmi3Int16)
UNSUPPORTED_SET(fmi3SetUInt16, fmi3UInt16)
UNSUPPORTED_SET(fmi3SetInt32, fmi3Int32)
UNSUPPORTED_SET(fmi3SetUInt32, fmi3UInt32)
UNSUPPORTED_SET(fmi3SetUInt64, fmi3UInt64)
UNSUPPORTED(fmi3SetString, REFERENCES, const fmi3String values[], size_t nValues)
UNSUPPORTED(fmi3GetBinary, REFERENCES, size_t valueSizes[], fmi3Binary values[], size_t nValues)
UNSUPPORTED(fmi3SetBinary, REFERENCES, const size_t valueSizes[], const fmi3Binary values[], size_t nValues)
UNSUPPORTED(fmi3GetClock, REFERENCES, fmi3Clock values[])
UNSUPPORTED(fmi3SetClock, REFERENCES, const fmi3Clock values[])
UNSUPPORTED(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t nValues)

UNSUPPORTED(fmi3GetNumberOfVariableDependencies, fmi3Instance instance, fmi3ValueReference valueReference,
            size_t *nDependencies)
UNSUPPORTED(fmi3GetVariableDependencies, fmi3Instance instance, fmi3ValueReference dependent,
            size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
            size_t elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[], size_t nDependencies)
/* Modes and clocks */
UNSUPPORTED(fmi3EnterEventMode, fmi3Instance instance)
UNSUPPORTED(fmi3EnterStepMode, fmi3Instance instance)
UNSUPPORTED(fmi3EnterConfigurationMode, fmi3Instance instance)
UNSUPPORTED(fmi3ExitConfigurationMode, fmi3Instance instance)
UNSUPPORTED(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
UNSUPPORTED(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
            fmi3IntervalQualifier qualifiers[])
UNSUPPORTED(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 shifts[])
UNSUPPORTED(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
UNSUPPORTED(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 intervals[])
UNSUPPORTED(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
UNSUPPORTED(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 shifts[])
UNSUPPORTED(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
UNSUPPORTED(fmi3EvaluateDiscreteStates, fmi3Instance instance)
UNSUPPORTED(fmi3UpdateDiscreteStates, fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
            fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
            fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
            fmi3Float64 *nextEventTime)
UNSUPPORTED(fmi3ActivateModelPartition, fmi3Instance instance, fmi3ValueReference clockReference,
            fmi3Float64 activationTime)

/* Model exchange */
UNSUPPORTED(fmi3EnterContinuousTimeMode, fmi3Instance instance)
UNSUPPORTED(fmi3CompletedIntegratorStep, fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
            fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
UNSUPPORTED(fmi3SetTime, fmi3Instance instance, fmi3Float64 time)
UNSUPPORTED(fmi3SetContinuousStates, fmi3Instance instance, const fmi3Float64 states[], size_t nStates)
UNSUPPORTED(fmi3GetContinuousStateDerivatives, fmi3Instance instance, fmi3Float64 derivatives[], size_t nStates)
UNSUPPORTED(fmi3GetEventIndicators, fmi3Instance instance, fmi3Float64 indicators[], size_t nIndicators)
UNSUPPORTED(fmi3GetContinuousStates, fmi3Instance instance, fmi3Float64 states[], size_t nStates)
UNSUPPORTED(fmi3GetNominalsOfContinuousStates, fmi3Instance instance, fmi3Float64 nominals[], size_t nStates)
UNSUPPORTED(fmi3GetNumberOfEventIndicators, fmi3Instance instance, size_t *nIndicators)
UNSUPPORTED(fmi3GetNumberOfContinuousStates, fmi3Instance instance, size_t *nStates)
