/* The functions that a host calls in every step. They are short and call nothing in the usual case; unusual cases are passed to
 * the functions with all checks (variables.c, derivatives.c). */
#include "calls.h"
#include "elementary.h"
#include "fresh.h"
#include "wide.h"

/* Most hosts set all inputs at once and in order; then no look-up is needed. */
static int are_all_inputs(const fmi2ValueReference vr[], size_t n)
{
    fmi2ValueReference other = 0;
    if (n != INPUTS) {
        return 0;
    }
    for (int k = 0; k < INPUTS; k++) {
        other |= vr[k] ^ input_references[k];
    }
    return other == 0;
}

static int are_in_range(const fmi2Real value[])
{
    for (int k = 0; k < INPUTS; k++) {
        const double given = fresh(value + k);
        if (!(given >= variables[k].minimum && given <= variables[k].maximum)) {
            return 0;
        }
    }
    return 1;
}

static int are_inputs(const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        const int place = place_of_input(vr[k]);
        if (place < 0 || !(value[k] >= variables[place].minimum && value[k] <= variables[place].maximum)) {
            return 0;
        }
    }
    return 1;
}

fmi2Status fmi2SetReal(fmi2Component instance, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    Component *c = (Component *)instance;
    if (c == NULL || c->memory.phase != STEPPING || vr == NULL || value == NULL) {
        return set_reals(instance, vr, n, value);
    }
    if (are_all_inputs(vr, n) && are_in_range(value)) {
        copy_fresh(c->memory.values.at, value, INPUTS);
        return fmi2OK;
    }
    if (!are_inputs(vr, n, value)) {
        return set_reals(instance, vr, n, value);
    }
    for (size_t k = 0; k < n; k++) {
        c->memory.values.at[variable_of_reference[vr[k]]] = value[k];
    }
    return fmi2OK;
}

static int are_finite_and_first(const fmi2Integer order[], const fmi2Real value[])
{
    fmi2Integer other = 0;
    double rest = 0.0; /* 0 if all values are finite */
    for (int k = 0; k < INPUTS; k++) {
        other |= order[k] != 1;
        const double given = fresh(value + k);
        rest += given - given;
    }
    return other == 0 && rest == 0.0;
}

static int are_first_derivatives(const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[])
{
    for (size_t k = 0; k < n; k++) {
        if (place_of_input(vr[k]) < 0 || order[k] != 1 || !is_finite(value[k])) {
            return 0;
        }
    }
    return 1;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component instance, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    Component *c = (Component *)instance;
    const int is_null = vr == NULL || order == NULL || value == NULL;
    if (c == NULL || !(c->memory.phase & SETTABLE) || is_null) {
        return slopes_refused(instance, n, is_null);
    }
    if (are_all_inputs(vr, n) && are_finite_and_first(order, value)) {
        copy_fresh(c->memory.slope, value, INPUTS);
        return fmi2OK;
    }
    if (!are_first_derivatives(vr, n, order, value)) {
        return slopes_refused(instance, n, is_null);
    }
    for (size_t k = 0; k < n; k++) {
        c->memory.slope[variable_of_reference[vr[k]]] = value[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    const Component *c = (const Component *)instance;
    GO_ON_WIDE(instance, fmi2GetReal(instance, vr, n, value));
    if (c == NULL || c->memory.phase != STEPPING || vr == NULL || value == NULL) {
        return get_reals(instance, vr, n, value);
    }
    for (size_t k = 0; k < n; k++) {
        const int index = vr[k] < REFERENCES ? real_of_reference[vr[k]] : -1;
        if (index < 0) {
            return get_reals(instance, vr, n, value);
        }
        value[k] = value_of(&c->memory, index);
    }
    return fmi2OK;
}
