/* Variables: look-up of value references, and checks of phase and range when setting. */
#include "calls.h"

/* NULL and a message if a reference is unknown or of another type. */
static const Variable *known(const Component *c, const char *function, fmi2ValueReference reference, Kind kind)
{
    const Variable *variable = find_variable(reference);
    if (variable == NULL || variable->kind != (int)kind) {
        not_known(c, function, reference, kind);
        return NULL;
    }
    return variable;
}

int all_known(const Component *c, const char *function, const fmi2ValueReference vr[], size_t n, Kind kind)
{
    for (size_t k = 0; k < n; k++) {
        if (known(c, function, vr[k], kind) == NULL) {
            return 0;
        }
    }
    return 1;
}

static int may_be_set(const Component *c, const char *function, const Variable *variable)
{
    return variable->settable & c->memory.phase || not_settable(c, function, variable);
}

/* Ranges exclude values that are not finite: the widest is -NO_LIMIT to NO_LIMIT. */
static int in_range(const Component *c, const char *function, const Variable *variable, double value)
{
    return (value >= variable->minimum && value <= variable->maximum) || out_of_range(c, function, variable, value);
}

/* Until initialization ends outputs follow inputs at once; later only a change of a parameter needs a check. In model exchange
 * outputs always follow inputs and states. */
static int asks_for_a_look(const Component *c, const Variable *variable)
{
    if (c->memory.phase & EXCHANGING) {
        return variable->settable & CONTINUOUS ? MOVED : CHANGED;
    }
    return c->memory.phase != STEPPING || !is_input(variable) ? CHANGED : 0;
}

/* The place of a variable that can be set. */
static double *place_of(Memory *memory, const Variable *variable)
{
    if (variable->index < REALS) {
        return memory->values.at + variable->index;
    }
    return model_state(memory, variable->index - FIRST_STATE);
}

/* The derivatives are computed when the first of them is read. */
static double read_real(Component *c, int index, double *rates, int *are_known)
{
    if (CONTINUOUS_STATES == 0 || index < REALS) {
        return value_of(&c->memory, index);
    }
    if (index >= FIRST_STATE) {
        return *model_state(&c->memory, index - FIRST_STATE);
    }
    if (!*are_known) {
        model_derivatives(&c->memory, c->work, rates);
        *are_known = 1;
    }
    return rates[index - FIRST_DERIVATIVE];
}

/* Only model exchange can have a state whose outputs are not finite. */
static int are_finite_results(const Component *c, const fmi2Real value[], size_t n)
{
    double rest = 0.0; /* 0 if all values are finite */
    for (size_t k = 0; k < n; k++) {
        rest += value[k] - value[k];
    }
    return !c->is_model_exchange || rest == 0.0;
}

/* The component if a function that takes arrays may be called in its phase, otherwise NULL. */
static Component *with_arrays(fmi2Component instance, const char *function, int phases, const fmi2ValueReference vr[],
                              size_t n, const void *value)
{
    Component *c = entered(instance, function, phases);
    if (c != NULL && n > 0 && (vr == NULL || value == NULL)) {
        refused(c, function, "an array is NULL");
        return NULL;
    }
    return c;
}

/* `value` is NULL for variables without a range. */
static int are_settable(const Component *c, const char *function, const fmi2ValueReference vr[], size_t n, Kind kind,
                        const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = known(c, function, vr[k], kind);
        if (variable == NULL || !may_be_set(c, function, variable) ||
            (value != NULL && !in_range(c, function, variable, value[k]))) {
            return 0;
        }
    }
    return 1;
}

fmi2Status get_reals(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Component *c = with_arrays(instance, "fmi2GetReal", READABLE, vr, n, value);
    double rates[CONTINUOUS_STATES + 1];
    int are_known = 0;
    if (c == NULL || !all_known(c, "fmi2GetReal", vr, n, REAL)) {
        return fmi2Error;
    }
    const fmi2Status status = updated(c, "fmi2GetReal");
    if (status != fmi2OK) {
        return status;
    }
    for (size_t k = 0; k < n; k++) {
        value[k] = read_real(c, known_variable(vr[k])->index, rates, &are_known);
    }
    return are_finite_results(c, value, n) ? fmi2OK : not_finite(c, "fmi2GetReal");
}

fmi2Status fmi2GetBoolean(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    const Component *c = with_arrays(instance, "fmi2GetBoolean", READABLE, vr, n, value);
    if (c == NULL || !all_known(c, "fmi2GetBoolean", vr, n, BOOLEAN)) {
        return fmi2Error;
    }
    for (size_t k = 0; k < n; k++) {
        value[k] = c->memory.flag[known_variable(vr[k])->index] ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status set_reals(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Component *c = with_arrays(instance, "fmi2SetReal", SETTABLE, vr, n, value);
    if (c == NULL || !are_settable(c, "fmi2SetReal", vr, n, REAL, value)) {
        return fmi2Error;
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = known_variable(vr[k]);
        *place_of(&c->memory, variable) = value[k];
        c->memory.stale |= asks_for_a_look(c, variable);
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    Component *c = with_arrays(instance, "fmi2SetBoolean", SETTABLE, vr, n, value);
    if (c == NULL || !are_settable(c, "fmi2SetBoolean", vr, n, BOOLEAN, NULL)) {
        return fmi2Error;
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = known_variable(vr[k]);
        c->memory.flag[variable->index] = value[k] != fmi2False;
        c->memory.stale |= asks_for_a_look(c, variable);
    }
    return fmi2OK;
}

/* There are no Integer and no String variables: an empty list is accepted, any reference is an error. */
static fmi2Status none_of(fmi2Component instance, const char *function, int phases, size_t n)
{
    const Component *c = entered(instance, function, phases);
    if (c == NULL) {
        return fmi2Error;
    }
    return n == 0 ? fmi2OK : refused(c, function, "this FMU has no variable of that type");
}

#define NO_VARIABLES(name, value_type, phases)                                                            \
    fmi2Status name(fmi2Component instance, const fmi2ValueReference vr[], size_t n, value_type value[]) \
    {                                                                                                     \
        (void)vr;                                                                                         \
        (void)value;                                                                                      \
        return none_of(instance, #name, phases, n);                                                       \
    }

NO_VARIABLES(fmi2GetInteger, fmi2Integer, READABLE)
NO_VARIABLES(fmi2GetString, fmi2String, READABLE)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer, SETTABLE)
NO_VARIABLES(fmi2SetString, const fmi2String, SETTABLE)
