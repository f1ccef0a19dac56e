/* Model exchange of FMI 3.0 in terms of exchange.h. */
#include "exchange.h"

#include <fmi3Functions.h>

/* Leave the calling function with an error unless the instance is one of model exchange in one of these phases. */
#define REQUIRE(instance, phases)                                                      \
    do {                                                                               \
        if (exchange_require((Instance *)(instance), (phases), __func__) != STATUS_OK) \
            return fmi3Error;                                                          \
    } while (0)

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    REQUIRE(instance, CONTINUOUS);
    ((Instance *)instance)->component.phase = EVENT;
    return fmi3OK;
}

static void clear(fmi3Boolean *flag)
{
    if (flag)
        *flag = fmi3False;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime)
{
    (void)nextEventTime;
    REQUIRE(instance, EVENT);
    clear(discreteStatesNeedUpdate);
    clear(terminateSimulation);
    clear(nominalsOfContinuousStatesChanged);
    clear(valuesOfContinuousStatesChanged);
    clear(nextEventTimeDefined);
    return fmi3OK;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    REQUIRE(instance, EVENT);
    ((Instance *)instance)->component.phase = CONTINUOUS;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    REQUIRE(instance, CONTINUOUS);
    clear(enterEventMode);
    clear(terminateSimulation);
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    REQUIRE(instance, EVENT | CONTINUOUS);
    return (fmi3Status)exchange_set_time(instance, time);
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[], size_t nStates)
{
    REQUIRE(instance, CONTINUOUS);
    return (fmi3Status)exchange_set_states(instance, states, nStates);
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 states[], size_t nStates)
{
    REQUIRE(instance, READABLE & ~INSTANTIATED);
    return (fmi3Status)exchange_get_states(instance, states, nStates);
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[], size_t nStates)
{
    REQUIRE(instance, READABLE & ~INSTANTIATED);
    return (fmi3Status)exchange_get_derivatives(instance, derivatives, nStates);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t nStates)
{
    REQUIRE(instance, READABLE);
    return (fmi3Status)exchange_get_nominals(instance, nominals, nStates);
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t nIndicators)
{
    (void)indicators;
    REQUIRE(instance, READABLE & ~INSTANTIATED);
    return (fmi3Status)exchange_get_indicators(instance, nIndicators);
}

static fmi3Status count(fmi3Instance instance, size_t *number, size_t value)
{
    if (!number)
        return (fmi3Status)component_fail(instance, "number: got a null pointer, expected where to store it");
    *number = value;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nIndicators)
{
    REQUIRE(instance, READABLE);
    return count(instance, nIndicators, 0);
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nStates)
{
    REQUIRE(instance, READABLE);
    return count(instance, nStates, N_STATES);
}
