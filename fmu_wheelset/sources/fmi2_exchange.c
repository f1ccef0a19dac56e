/* Model exchange of FMI 2.0 in terms of exchange.h. */
#include "exchange.h"

#include <fmi2Functions.h>

/* Leave the calling function with an error unless the instance is one of model exchange in one of these phases. */
#define REQUIRE(c, phases)                                                      \
    do {                                                                        \
        if (exchange_require((Instance *)(c), (phases), __func__) != STATUS_OK) \
            return fmi2Error;                                                   \
    } while (0)

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    REQUIRE(c, CONTINUOUS);
    ((Instance *)c)->component.phase = EVENT;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    static const fmi2EventInfo NOTHING = {fmi2False, fmi2False, fmi2False, fmi2False, fmi2False, 0.0};
    REQUIRE(c, EVENT);
    if (info)
        *info = NOTHING;
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    REQUIRE(c, EVENT);
    ((Instance *)c)->component.phase = CONTINUOUS;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation)
{
    (void)noSetFMUStatePriorToCurrentPoint;
    REQUIRE(c, CONTINUOUS);
    if (enterEventMode)
        *enterEventMode = fmi2False;
    if (terminateSimulation)
        *terminateSimulation = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    REQUIRE(c, EVENT | CONTINUOUS);
    return (fmi2Status)exchange_set_time(c, time);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx)
{
    REQUIRE(c, CONTINUOUS);
    return (fmi2Status)exchange_set_states(c, x, nx);
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx)
{
    REQUIRE(c, READABLE & ~INSTANTIATED);
    return (fmi2Status)exchange_get_states(c, x, nx);
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx)
{
    REQUIRE(c, READABLE & ~INSTANTIATED);
    return (fmi2Status)exchange_get_derivatives(c, derivatives, nx);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t nx)
{
    REQUIRE(c, READABLE);
    return (fmi2Status)exchange_get_nominals(c, nominals, nx);
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t ni)
{
    (void)indicators;
    REQUIRE(c, READABLE & ~INSTANTIATED);
    return (fmi2Status)exchange_get_indicators(c, ni);
}
