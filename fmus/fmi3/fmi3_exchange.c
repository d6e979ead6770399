/* FMI 3.0: FMU states, and model exchange. Every function passes its call on to the core. */
#include "fmi3_instance.h"

/* ---- FMU states ------------------------------------------------------------------------------------------------------- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    return status3(fmi2GetFMUstate(core_of(instance, "fmi3GetFMUState"), state));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    return status3(fmi2SetFMUstate(core_of(instance, "fmi3SetFMUState"), state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    return status3(fmi2FreeFMUstate(core_of(instance, "fmi3FreeFMUState"), state));
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    return status3(fmi2SerializedFMUstateSize(core_of(instance, "fmi3SerializedFMUStateSize"), state, size));
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return status3(fmi2SerializeFMUstate(core_of(instance, "fmi3SerializeFMUState"), state, (fmi2Byte *)bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return status3(
        fmi2DeSerializeFMUstate(core_of(instance, "fmi3DeserializeFMUState"), (const fmi2Byte *)bytes, size, state));
}

/* ---- Modes of model exchange ------------------------------------------------------------------------------------------ */

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    return status3(fmi2EnterEventMode(core_of(instance, "fmi3EnterEventMode")));
}

/* There are no clocks and no discrete states. */
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    const Component *core = core_of(instance, "fmi3EvaluateDiscreteStates");
    if (core == NULL || core->memory.phase & (INITIALIZING | EVENT)) {
        return core == NULL ? fmi3Error : fmi3OK;
    }
    return refused3(instance, "fmi3EvaluateDiscreteStates", "is only allowed in initialization mode and event mode");
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *need_update, fmi3Boolean *terminate,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *values_changed, fmi3Boolean *has_next,
                                    fmi3Float64 *next)
{
    fmi2EventInfo info;
    Component *core = core_of(instance, "fmi3UpdateDiscreteStates");
    if (core != NULL && (need_update == NULL || terminate == NULL || nominals_changed == NULL || values_changed == NULL ||
                         has_next == NULL || next == NULL)) {
        return refused3(instance, "fmi3UpdateDiscreteStates", "an address for a result is NULL");
    }
    const fmi2Status status = fmi2NewDiscreteStates(core, &info);
    if (status == fmi2OK) {
        *need_update = *terminate = *nominals_changed = *values_changed = *has_next = fmi3False;
        *next = 0.0;
    }
    return status3(status);
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    return status3(fmi2EnterContinuousTimeMode(core_of(instance, "fmi3EnterContinuousTimeMode")));
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_set_state, fmi3Boolean *event,
                                       fmi3Boolean *terminate)
{
    Component *core = core_of(instance, "fmi3CompletedIntegratorStep");
    fmi2Boolean enter = fmi2False, end = fmi2False;
    if (core != NULL && (event == NULL || terminate == NULL)) {
        return refused3(instance, "fmi3CompletedIntegratorStep", "an address for a result is NULL");
    }
    const fmi2Status status = fmi2CompletedIntegratorStep(core, no_set_state, &enter, &end);
    if (status == fmi2OK) {
        *event = enter != fmi2False;
        *terminate = end != fmi2False;
    }
    return status3(status);
}

/* ---- Time, states, derivatives ---------------------------------------------------------------------------------------- */

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    return status3(fmi2SetTime(core_of(instance, "fmi3SetTime"), time));
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n)
{
    return status3(fmi2SetContinuousStates(core_of(instance, "fmi3SetContinuousStates"), x, n));
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n)
{
    return status3(fmi2GetContinuousStates(core_of(instance, "fmi3GetContinuousStates"), x, n));
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[], size_t n)
{
    return status3(fmi2GetDerivatives(core_of(instance, "fmi3GetContinuousStateDerivatives"), derivatives, n));
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t n)
{
    return status3(fmi2GetNominalsOfContinuousStates(core_of(instance, "fmi3GetNominalsOfContinuousStates"), nominals, n));
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n)
{
    return status3(fmi2GetEventIndicators(core_of(instance, "fmi3GetEventIndicators"), indicators, n));
}

static fmi3Status count(fmi3Instance instance, const char *function, size_t number, size_t *n)
{
    const Component *core = core_of(instance, function);
    if (core == NULL) {
        return fmi3Error;
    }
    if (!core->is_model_exchange) {
        return refused3(instance, function, "this instance is for co-simulation");
    }
    if (n == NULL) {
        return refused3(instance, function, "the address for the result is NULL");
    }
    *n = number;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n)
{
    return count(instance, "fmi3GetNumberOfEventIndicators", 0, n);
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n)
{
    return count(instance, "fmi3GetNumberOfContinuousStates", CONTINUOUS_STATES, n);
}
