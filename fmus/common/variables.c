/* Variables: what a value reference is, what may be set when, in which range. */
#include "instance.h"
#include "elementary.h"

static fmi2Status unknown(const Component *c, const char *function, fmi2ValueReference reference, Kind kind)
{
    Message message = {.length = 0};
    say(&message, "value reference ");
    say_number(&message, (double)reference);
    say(&message, kind == REAL ? " is no Real variable of this FMU" : " is no Boolean variable of this FMU");
    return refused(c, function, message.text);
}

int all_known(const Component *c, const char *function, const fmi2ValueReference vr[], size_t n, Kind kind)
{
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = find_variable(vr[k]);
        if (variable == NULL || variable->kind != (int)kind) {
            unknown(c, function, vr[k], kind);
            return 0;
        }
    }
    return 1;
}

static int not_settable(const Component *c, const char *function, const Variable *variable)
{
    Message message = {.length = 0};
    say(&message, variable->name);
    say(&message, variable->settable ? " is fixed: set it before initialization ends"
                                     : " is computed by the FMU and cannot be set");
    refused(c, function, message.text);
    return 0;
}

static int may_be_set(const Component *c, const char *function, const Variable *variable)
{
    return variable->settable & c->memory.phase || not_settable(c, function, variable);
}

/* "must be finite", "must be at least 0 and finite", "must be at least 0.001 and at most 10". */
static void say_range(Message *message, const Variable *variable)
{
    const int low = variable->minimum > -NO_LIMIT, high = variable->maximum < NO_LIMIT;
    say(message, " must be ");
    if (low) {
        say(message, "at least ");
        say_number(message, variable->minimum);
        say(message, " and ");
    }
    if (high) {
        say(message, "at most ");
        say_number(message, variable->maximum);
    }
    say(message, high ? "" : "finite");
}

static int out_of_range(const Component *c, const char *function, const Variable *variable, double value)
{
    Message message = {.length = 0};
    say(&message, variable->name);
    say(&message, " = ");
    say_number(&message, value);
    say(&message, variable->unit[0] == '\0' ? "" : " ");
    say(&message, variable->unit);
    say_range(&message, variable);
    say(&message, "; the old value stays");
    refused(c, function, message.text);
    return 0;
}

static int in_range(const Component *c, const char *function, const Variable *variable, double value)
{
    return (is_finite(value) && value >= variable->minimum && value <= variable->maximum) ||
           out_of_range(c, function, variable, value);
}

/* Outputs follow inputs at once until initialization ends; later only a parameter asks to be looked at. */
static void was_set(Component *c, const Variable *variable)
{
    if (c->memory.phase != STEPPING || !is_input(variable)) {
        c->memory.stale = 1;
    }
}


fmi2Status fmi2GetReal(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    Component *c = entered(instance, "fmi2GetReal", READABLE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (n > 0 && (vr == NULL || value == NULL)) {
        return refused(c, "fmi2GetReal", "an array is NULL");
    }
    if (!all_known(c, "fmi2GetReal", vr, n, REAL) || !is_current(c, "fmi2GetReal")) {
        return fmi2Error;
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = find_variable(vr[k]);
        if (variable->is_output) {
            model_output(&c->memory, variable->index - INPUTS);
        }
        value[k] = c->memory.values.at[variable->index];
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    Component *c = entered(instance, "fmi2GetBoolean", READABLE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (n > 0 && (vr == NULL || value == NULL)) {
        return refused(c, "fmi2GetBoolean", "an array is NULL");
    }
    if (!all_known(c, "fmi2GetBoolean", vr, n, BOOLEAN)) {
        return fmi2Error;
    }
    for (size_t k = 0; k < n; k++) {
        value[k] = c->memory.flag[find_variable(vr[k])->index] ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Component *c = entered(instance, "fmi2SetReal", SETTABLE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (n > 0 && (vr == NULL || value == NULL)) {
        return refused(c, "fmi2SetReal", "an array is NULL");
    }
    if (!all_known(c, "fmi2SetReal", vr, n, REAL)) {
        return fmi2Error;
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = find_variable(vr[k]);
        if (!may_be_set(c, "fmi2SetReal", variable) || !in_range(c, "fmi2SetReal", variable, value[k])) {
            return fmi2Error;
        }
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = find_variable(vr[k]);
        c->memory.values.at[variable->index] = value[k];
        was_set(c, variable);
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    Component *c = entered(instance, "fmi2SetBoolean", SETTABLE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (n > 0 && (vr == NULL || value == NULL)) {
        return refused(c, "fmi2SetBoolean", "an array is NULL");
    }
    if (!all_known(c, "fmi2SetBoolean", vr, n, BOOLEAN)) {
        return fmi2Error;
    }
    for (size_t k = 0; k < n; k++) {
        if (!may_be_set(c, "fmi2SetBoolean", find_variable(vr[k]))) {
            return fmi2Error;
        }
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *variable = find_variable(vr[k]);
        c->memory.flag[variable->index] = value[k] != fmi2False;
        was_set(c, variable);
    }
    return fmi2OK;
}

/* There are no Integer and no String variables: asking for none is fine, for any is an error. */
static fmi2Status none_of(fmi2Component instance, const char *function, int phases, size_t n)
{
    const Component *c = entered(instance, function, phases);
    if (c == NULL) {
        return fmi2Error;
    }
    return n == 0 ? fmi2OK : refused(c, function, "this FMU has no variable of that type");
}

fmi2Status fmi2GetInteger(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    (void)vr;
    (void)value;
    return none_of(instance, "fmi2GetInteger", READABLE, n);
}

fmi2Status fmi2GetString(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)vr;
    (void)value;
    return none_of(instance, "fmi2GetString", READABLE, n);
}

fmi2Status fmi2SetInteger(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    (void)vr;
    (void)value;
    return none_of(instance, "fmi2SetInteger", SETTABLE, n);
}

fmi2Status fmi2SetString(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)vr;
    (void)value;
    return none_of(instance, "fmi2SetString", SETTABLE, n);
}
