/* What modelDescription.xml of FMI 3.0 does not announce. */
#include "component.h"

#include <fmi3Functions.h>

#pragma GCC diagnostic ignored "-Wunused-parameter"
#define GET(name, type)                                                                                     \
    fmi3Status name(fmi3Instance instance, const fmi3ValueReference valueReferences[],                      \
                    size_t nValueReferences, type values[], size_t nValues)
#define SET(name, type) GET(name, const type)
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
UNSUPPORTED(fmi3ActivateModelPartition, fmi3Instance instance, fmi3ValueReference clockReference,
            fmi3Float64 activationTime)
