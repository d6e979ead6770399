/* FMI 3.0: Float64 and Boolean variables, and derivatives of some by others. All variables are scalars. */
#include <string.h>

#include "fmi3_instance.h"

int has_all_values(fmi3Instance instance, const char *function, size_t references, size_t values)
{
    if (references == values) {
        return 1;
    }
    refused3(instance, function, "give one value for each reference, because all variables are scalars");
    return 0;
}

/* ---- Float64 ---------------------------------------------------------------------------------------------------------- */

/* The position of the independent variable in a list; n if it is not there. */
static size_t place_of_time(const fmi3ValueReference vr[], size_t n)
{
    size_t k = 0;
    while (k < n && vr[k] != TIME_REFERENCE) {
        k++;
    }
    return k;
}

/* Before initialization a host can read what it can set. */
static fmi3Status read_start(const Component *core, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[])
{
    if (!all_known(core, "fmi3GetFloat64", references2(vr), n, REAL)) {
        return fmi3Error;
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = known_variable(vr[k]);
        if (!(variable->settable & INSTANTIATED)) {
            return status3(refused(core, "fmi3GetFloat64", "a variable has no value before initialization mode"));
        }
        values[k] = core->memory.values.at[variable->index];
    }
    return fmi3OK;
}

static fmi3Status read_without_time(Component *core, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[])
{
    if (n == 0) {
        return fmi3OK;
    }
    return core->memory.phase == INSTANTIATED ? read_start(core, vr, n, values)
                                              : status3(fmi2GetReal(core, references2(vr), n, values));
}

/* 0 and a message if a variable other than time is unknown. */
static int all_known_but_time(const Component *core, const fmi3ValueReference vr[], size_t n)
{
    for (size_t k = 0; k < n; k++) {
        if (vr[k] != TIME_REFERENCE && !all_known(core, "fmi3GetFloat64", references2(vr + k), 1, REAL)) {
            return 0;
        }
    }
    return 1;
}

/* The variables between two places of time are read with one call of the core. */
static fmi3Status read_with_time(Component *core, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[])
{
    fmi3Status status = all_known_but_time(core, vr, n) ? fmi3OK : fmi3Error;
    for (size_t first = 0; first < n && status == fmi3OK;) {
        const size_t place = first + place_of_time(vr + first, n - first);
        status = read_without_time(core, vr + first, place - first, values + first);
        if (place < n) {
            values[place] = core->memory.time;
        }
        first = place + 1;
    }
    return status;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                          size_t n_values)
{
    Component *core = core_of(instance, "fmi3GetFloat64");
    if (core == NULL || !has_all_values(instance, "fmi3GetFloat64", n, n_values)) {
        return fmi3Error;
    }
    if (n > 0 && (vr == NULL || values == NULL)) {
        return refused3(instance, "fmi3GetFloat64", "an array is NULL");
    }
    return place_of_time(vr, n) < n ? read_with_time(core, vr, n, values) : read_without_time(core, vr, n, values);
}

/* In an intermediate update, only inputs. */
static int may_set(const Instance *instance, const fmi3ValueReference vr[], size_t n)
{
    for (size_t k = 0; k < n && instance->is_updating; k++) {
        if (place_of_input(vr[k]) < 0) {
            return 0;
        }
    }
    return 1;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t n_values)
{
    const Instance *own = (const Instance *)instance;
    if (own == NULL || !has_all_values(instance, "fmi3SetFloat64", n, n_values)) {
        return fmi3Error;
    }
    if (n > 0 && vr == NULL) {
        return refused3(instance, "fmi3SetFloat64", "an array is NULL");
    }
    if (place_of_time(vr, n) < n) {
        return refused3(instance, "fmi3SetFloat64", "time is not set as a variable: steps and fmi3SetTime change it");
    }
    if (!may_set(own, vr, n)) {
        return refused3(instance, "fmi3SetFloat64", "an intermediate update sets inputs only");
    }
    return status3(fmi2SetReal(own->core, references2(vr), n, values));
}

/* ---- Boolean ---------------------------------------------------------------------------------------------------------- */

static fmi3Status read_boolean(Component *core, fmi3ValueReference reference, fmi3Boolean *value)
{
    fmi2Boolean number = fmi2False;
    if (core->memory.phase != INSTANTIATED) {
        const fmi2Status status = fmi2GetBoolean(core, references2(&reference), 1, &number);
        *value = status == fmi2OK ? number != fmi2False : *value;
        return status3(status);
    }
    if (!all_known(core, "fmi3GetBoolean", references2(&reference), 1, BOOLEAN)) {
        return fmi3Error;
    }
    *value = core->memory.flag[known_variable(reference)->index] != 0;
    return fmi3OK;
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Boolean values[],
                          size_t n_values)
{
    Component *core = core_of(instance, "fmi3GetBoolean");
    fmi3Status status = fmi3OK;
    if (core == NULL || !has_all_values(instance, "fmi3GetBoolean", n, n_values)) {
        return fmi3Error;
    }
    if (n > 0 && (vr == NULL || values == NULL)) {
        return refused3(instance, "fmi3GetBoolean", "an array is NULL");
    }
    for (size_t k = 0; k < n && status == fmi3OK; k++) {
        status = read_boolean(core, vr[k], values + k);
    }
    return status;
}

/* The core takes another type of Boolean, so it gets one at a time; if one is refused, none is set. */
fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Boolean values[],
                          size_t n_values)
{
    Component *core = core_of(instance, "fmi3SetBoolean");
    if (core == NULL || !has_all_values(instance, "fmi3SetBoolean", n, n_values)) {
        return fmi3Error;
    }
    if (n > 0 && (vr == NULL || values == NULL)) {
        return refused3(instance, "fmi3SetBoolean", "an array is NULL");
    }
    fmi2Status status = fmi2SetBoolean(core, NULL, 0, NULL);
    const int64_t stale = core->memory.stale;
    int64_t flags[FLAGS];
    memcpy(flags, core->memory.flag, sizeof flags);
    for (size_t k = 0; k < n && status == fmi2OK; k++) {
        const fmi2Boolean number = values[k] ? fmi2True : fmi2False;
        status = fmi2SetBoolean(core, references2(vr + k), 1, &number);
    }
    if (status != fmi2OK) {
        memcpy(core->memory.flag, flags, sizeof flags);
        core->memory.stale = stale;
    }
    return status3(status);
}

/* ---- Derivatives and dependencies ------------------------------------------------------------------------------------- */

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    Component *core = core_of(instance, "fmi3GetDirectionalDerivative");
    if (core == NULL || !has_all_values(instance, "fmi3GetDirectionalDerivative", n_knowns, n_seed) ||
        !has_all_values(instance, "fmi3GetDirectionalDerivative", n_unknowns, n_sensitivity)) {
        return fmi3Error;
    }
    return status3(fmi2GetDirectionalDerivative(core, references2(unknowns), n_unknowns, references2(knowns), n_knowns,
                                                seed, sensitivity));
}

/* The sum over all unknowns of seed times derivative by one known. */
static fmi2Status add_up(Component *core, const fmi3ValueReference unknowns[], size_t n, const fmi3ValueReference *known,
                         const fmi3Float64 seed[], fmi3Float64 *sum)
{
    const double one = 1.0;
    *sum = 0.0;
    for (size_t k = 0; k < n; k++) {
        double derivative = 0.0;
        const fmi2Status status = fmi2GetDirectionalDerivative(core, references2(unknowns + k), 1, references2(known), 1,
                                                               &one, &derivative);
        if (status != fmi2OK) {
            return status;
        }
        *sum += seed[k] * derivative;
    }
    return fmi2OK;
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    Component *core = core_of(instance, "fmi3GetAdjointDerivative");
    if (core == NULL || !has_all_values(instance, "fmi3GetAdjointDerivative", n_unknowns, n_seed) ||
        !has_all_values(instance, "fmi3GetAdjointDerivative", n_knowns, n_sensitivity)) {
        return fmi3Error;
    }
    if ((n_unknowns > 0 && (unknowns == NULL || seed == NULL)) || (n_knowns > 0 && (knowns == NULL || sensitivity == NULL))) {
        return refused3(instance, "fmi3GetAdjointDerivative", "an array is NULL");
    }
    if (entered(core, "fmi3GetAdjointDerivative", READABLE) == NULL ||
        !derivable(core, "fmi3GetAdjointDerivative", unknowns, n_unknowns, 1) ||
        !derivable(core, "fmi3GetAdjointDerivative", knowns, n_knowns, 0)) {
        return fmi3Error;
    }
    fmi2Status status = fmi2OK;
    for (size_t k = 0; k < n_knowns && status == fmi2OK; k++) {
        status = add_up(core, unknowns, n_unknowns, knowns + k, seed, sensitivity + k);
    }
    return status3(status);
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference reference, size_t *n)
{
    (void)reference;
    (void)n;
    return refused3(instance, "fmi3GetNumberOfVariableDependencies",
                    "dependencies are in modelDescription.xml (providesPerElementDependencies is false)");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t elements[],
                                       fmi3ValueReference independents[], size_t independent_elements[],
                                       fmi3DependencyKind kinds[], size_t n)
{
    (void)dependent;
    (void)elements;
    (void)independents;
    (void)independent_elements;
    (void)kinds;
    (void)n;
    return refused3(instance, "fmi3GetVariableDependencies",
                    "dependencies are in modelDescription.xml (providesPerElementDependencies is false)");
}
