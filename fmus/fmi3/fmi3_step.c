/* FMI 3.0: co-simulation steps. FMI 3.0 has no derivatives of inputs; inputs that change during a step come from the host's callback
 * for intermediate updates. It is called once per step, for the end of the step; from their values at both ends the inputs change
 * linearly. */
#include <string.h>

#include "fmi3_instance.h"

/* Lets the host set the inputs at the end of the step, and keeps the change as the inputs' derivatives. */
static void ask_for_inputs(Instance *instance, double time, double h)
{
    Memory *m = &instance->core->memory;
    double from[INPUTS];
    fmi3Boolean early = fmi3False;
    fmi3Float64 early_time = time + h;
    memcpy(from, m->values.at, sizeof from);
    instance->is_updating = 1;
    instance->update(instance->environment, time + h, fmi3True, fmi3False, fmi3False, fmi3False, &early, &early_time);
    instance->is_updating = 0;
    for (int k = 0; k < INPUTS; k++) {
        m->slope[k] = (m->values.at[k] - from[k]) / h;
        m->values.at[k] = from[k];
    }
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 h, fmi3Boolean no_set_state,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    Instance *own = (Instance *)instance;
    Component *core = core_of(instance, "fmi3DoStep");
    double slope[INPUTS];
    if (core == NULL) {
        return fmi3Error;
    }
    if (event == NULL || terminate == NULL || early == NULL || last == NULL) {
        return refused3(instance, "fmi3DoStep", "an address for a result is NULL");
    }
    memcpy(slope, core->memory.slope, sizeof slope);
    if (own->update != NULL && core->memory.phase == STEPPING) {
        if (!is_next_step(core, time, h)) {
            return fmi3Error;
        }
        ask_for_inputs(own, time, h);
    }
    const fmi2Status status = fmi2DoStep(core, time, h, no_set_state);
    if (status != fmi2OK) {
        memcpy(core->memory.slope, slope, sizeof slope);
    }
    *event = fmi3False;
    *terminate = fmi3False;
    *early = fmi3False;
    *last = core->memory.time;
    return status3(status);
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return refused3(instance, "fmi3EnterStepMode", "event mode is not offered (hasEventMode is false)");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Int32 order[],
                                    fmi3Float64 values[], size_t n_values)
{
    Component *core = core_of(instance, "fmi3GetOutputDerivatives");
    if (core == NULL || !has_all_values(instance, "fmi3GetOutputDerivatives", n, n_values)) {
        return fmi3Error;
    }
    return status3(fmi2GetRealOutputDerivatives(core, references2(vr), n, order, values));
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time)
{
    (void)clock;
    (void)time;
    return refused3(instance, "fmi3ActivateModelPartition", "scheduled execution is not offered");
}
