/* Directional derivatives of outputs, derivatives of inputs. */
#include "instance.h"
#include "elementary.h"

/* Smallest size of a variable for finite differences above rounding; forces and stiffnesses are much larger numbers than metres. */
static double least_size(const Variable *variable)
{
    return variable->unit[0] == 'N' ? 1e3 : 1e-3;
}

/* d output / d known of the start, by central differences, because the start solves for the state and has no formula. */
static double start_derivative(Component *c, int output, int known, double least)
{
    Message why = {.length = 0};
    double ends[2] = {0.0, 0.0};
    double places[2];
    const double value = c->memory.values.at[known], size = value < 0.0 ? -value : value;
    const double change = 6e-6 * (size > least ? size : least);
    for (int side = 0; side < 2; side++) {
        Memory trial = c->memory;
        trial.values.at[known] = places[side] = side ? value + change : value - change;
        if (!model_start(&trial, c->work, &why)) {
            return 0.0;
        }
        ends[side] = value_of(&trial, output);
    }
    return (ends[1] - ends[0]) / (places[1] - places[0]);
}

static double derivative(Component *c, const Variable *output, const Variable *known)
{
    return c->memory.phase == INITIALIZING ? start_derivative(c, output->index, known->index, least_size(known))
                                           : model_direct_term(&c->memory, output->index, known->index);
}

static const char *reason_not_to_derive(const Component *c, const Variable *variable, int is_unknown)
{
    if (is_unknown) {
        return variable->is_output ? NULL : "an unknown must be an output";
    }
    return is_input(variable) || (c->memory.phase == INITIALIZING && (variable->settable & INITIALIZING))
               ? NULL
               : "a known must be an input, or in initialization mode a parameter";
}

static int derivable(const Component *c, const fmi2ValueReference vr[], size_t n, int is_unknown)
{
    if (!all_known(c, "fmi2GetDirectionalDerivative", vr, n, REAL)) {
        return 0;
    }
    for (size_t k = 0; k < n; k++) {
        const char *reason = reason_not_to_derive(c, known_variable(vr[k]), is_unknown);
        if (reason != NULL) {
            refused(c, "fmi2GetDirectionalDerivative", reason);
            return 0;
        }
    }
    return 1;
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
    if (!derivable(c, unknowns, n_unknown, 1) || !derivable(c, knowns, n_known, 0) ||
        !is_current(c, "fmi2GetDirectionalDerivative")) {
        return fmi2Error;
    }
    for (size_t i = 0; i < n_unknown; i++) {
        double sum = 0.0;
        for (size_t k = 0; k < n_known; k++) {
            sum += derivative(c, known_variable(unknowns[i]), known_variable(knowns[k])) * direction[k];
        }
        result[i] = sum;
    }
    return fmi2OK;
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
