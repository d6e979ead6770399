/* Directional derivatives of outputs, derivatives of inputs. */
#include <string.h>

#include "calls.h"
#include "elementary.h"

/* Smallest size of a variable for finite differences above rounding; forces and stiffnesses are much larger numbers than metres, and
 * so are coefficients of squares of metres. */
static double least_size(const Variable *variable)
{
    if (strcmp(variable->unit, "N/m2") == 0) {
        return 1e6;
    }
    return variable->unit[0] == 'N' ? 1e3 : 1e-3;
}

/* The value of an output, a derivative or a state, with the derivatives of all states at hand. */
static double unknown_of(Memory *memory, int index, const double *rates)
{
    if (index >= FIRST_STATE && CONTINUOUS_STATES > 0) {
        return *model_state(memory, index - FIRST_STATE);
    }
    return index < FIRST_DERIVATIVE ? value_of(memory, index) : rates[index - FIRST_DERIVATIVE];
}

/* d unknown / d known of the start, by central differences, because the start solves for the state and has no formula. */
static double start_derivative(Component *c, int unknown, int known, double least)
{
    Message why = {.length = 0};
    double ends[2] = {0.0, 0.0};
    double places[2], rates[CONTINUOUS_STATES + 1] = {0.0};
    const double value = c->memory.values.at[known], size = value < 0.0 ? -value : value;
    const double change = 6e-6 * (size > least ? size : least);
    for (int side = 0; side < 2; side++) {
        Memory trial = c->memory;
        trial.values.at[known] = places[side] = side ? value + change : value - change;
        if (!model_start(&trial, c->work, &why)) {
            return 0.0;
        }
        if (unknown >= FIRST_DERIVATIVE) {
            model_derivatives(&trial, c->work, rates);
        }
        ends[side] = unknown_of(&trial, unknown, rates);
    }
    return (ends[1] - ends[0]) / (places[1] - places[0]);
}

/* Whether a Real variable has one of the indices, as many as there are states, that begin with `first`. */
static int is_one_of_states(const Variable *variable, int first)
{
    return variable->index >= first && variable->index < first + CONTINUOUS_STATES;
}

static const char *reason_not_to_derive(const Component *c, const Variable *variable, int is_unknown)
{
    const int is_state = is_one_of_states(variable, FIRST_STATE), is_derivative = is_one_of_states(variable, FIRST_DERIVATIVE);
    if (is_unknown) {
        return variable->is_output || is_derivative || (is_state && c->memory.phase == INITIALIZING) ? NULL : "an unknown must be an output or a derivative of a state";
    }
    if (c->memory.phase == INITIALIZING) {
        return variable->settable & INITIALIZING ? NULL : "a known must be an input or a parameter in initialization mode";
    }
    return is_input(variable) || is_state ? NULL : "a known must be an input or a state, or in initialization mode a parameter";
}

int derivable(const Component *c, const char *function, const fmi2ValueReference vr[], size_t n, int is_unknown)
{
    if (!all_known(c, function, vr, n, REAL)) {
        return 0;
    }
    for (size_t k = 0; k < n; k++) {
        const char *reason = reason_not_to_derive(c, known_variable(vr[k]), is_unknown);
        if (reason != NULL) {
            refused(c, function, reason);
            return 0;
        }
    }
    return 1;
}

/* The unknowns' change at the start. */
static void start_changes(Component *c, const fmi2ValueReference unknowns[], size_t n_unknown,
                          const fmi2ValueReference knowns[], size_t n_known, const double direction[], double result[])
{
    for (size_t i = 0; i < n_unknown; i++) {
        double sum = 0.0;
        for (size_t k = 0; k < n_known; k++) {
            const Variable *known = known_variable(knowns[k]);
            sum += start_derivative(c, known_variable(unknowns[i])->index, known->index, least_size(known)) * direction[k];
        }
        result[i] = sum;
    }
}

/* Adds a known's change to the directions; returns whether the known is a state. */
static int add_direction(double *inputs, double *states, int index, double change)
{
    if (index < INPUTS) {
        inputs[index] += change;
        return 0;
    }
    states[index - FIRST_STATE] += change;
    return 1;
}

static double change_of(const double *outputs, const double *rates, int index)
{
    return index < FIRST_DERIVATIVE ? outputs[index - INPUTS] : rates[index - FIRST_DERIVATIVE];
}

/* The unknowns' change at the present inputs and states. */
static void changes(Component *c, const fmi2ValueReference unknowns[], size_t n_unknown, const fmi2ValueReference knowns[],
                    size_t n_known, const double direction[], double result[])
{
    double inputs[INPUTS] = {0.0};
    double states[CONTINUOUS_STATES + 1] = {0.0};
    double outputs[OUTPUTS] = {0.0};
    double rates[CONTINUOUS_STATES + 1] = {0.0};
    int has_states = 0, has_rates = 0;
    for (size_t k = 0; k < n_known; k++) {
        has_states |= add_direction(inputs, states, known_variable(knowns[k])->index, direction[k]);
    }
    for (size_t i = 0; i < n_unknown; i++) {
        has_rates |= known_variable(unknowns[i])->index >= FIRST_DERIVATIVE;
    }
    model_tangent(&c->memory, c->work, inputs, has_states ? states : NULL, outputs, has_rates ? rates : NULL);
    for (size_t i = 0; i < n_unknown; i++) {
        result[i] = change_of(outputs, rates, known_variable(unknowns[i])->index);
    }
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component instance, const fmi2ValueReference unknowns[], size_t n_unknown,
                                        const fmi2ValueReference knowns[], size_t n_known, const fmi2Real direction[],
                                        fmi2Real result[])
{
    Component *c = entered(instance, "fmi2GetDirectionalDerivative", READABLE);
    if (c == NULL) {
        return fmi2Error;
    }
    if ((n_unknown > 0 && (unknowns == NULL || result == NULL)) ||
        (n_known > 0 && (knowns == NULL || direction == NULL))) {
        return refused(c, "fmi2GetDirectionalDerivative", "an array is NULL");
    }
    if (!derivable(c, "fmi2GetDirectionalDerivative", unknowns, n_unknown, 1) ||
        !derivable(c, "fmi2GetDirectionalDerivative", knowns, n_known, 0)) {
        return fmi2Error;
    }
    const fmi2Status status = updated(c, "fmi2GetDirectionalDerivative");
    if (status == fmi2OK && c->memory.phase == INITIALIZING) {
        start_changes(c, unknowns, n_unknown, knowns, n_known, direction, result);
    } else if (status == fmi2OK) {
        changes(c, unknowns, n_unknown, knowns, n_known, direction, result);
    }
    return status;
}

fmi2Status slopes_refused(fmi2Component instance, size_t n, int is_null)
{
    const Component *c = entered(instance, "fmi2SetRealInputDerivatives", SETTABLE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (n == 0) {
        return fmi2OK;
    }
    return refused(c, "fmi2SetRealInputDerivatives",
                   is_null ? "an array is NULL" : "give finite first derivatives (order 1) of inputs");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component instance, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    const Component *c = entered(instance, "fmi2GetRealOutputDerivatives", STEPPING | TERMINATED);
    (void)vr;
    (void)order;
    (void)value;
    if (c == NULL) {
        return fmi2Error;
    }
    return n == 0 ? fmi2OK
                  : refused(c, "fmi2GetRealOutputDerivatives", "output derivatives are not supported "
                                                               "(maxOutputDerivativeOrder is 0)");
}
