/* Model exchange: the host integrates the continuous states. The derivatives have kinks but no jumps and do not depend on time, so
 * there are no event indicators and no time events, and event mode has nothing to do except to accept parameters. */
#include <string.h>

#include "calls.h"
#include "elementary.h"

/* The component if it is an instance for model exchange and the function may be called in its phase, otherwise NULL. */
static Component *exchanging(fmi2Component instance, const char *function, int phases)
{
    const Component *c = (const Component *)instance;
    if (c != NULL && !c->is_model_exchange) {
        refused(c, function, "this instance is for co-simulation");
        return NULL;
    }
    return entered(instance, function, phases);
}

static fmi2Status refused_array(const Component *c, const char *function)
{
    Message message = {.length = 0};
    say(&message, "give an array of ");
    say_number(&message, (double)CONTINUOUS_STATES);
    say(&message, " numbers, one for each continuous state");
    return refused(c, function, message.text);
}

static int is_array_of_states(const fmi2Real x[], size_t n)
{
    return n == CONTINUOUS_STATES && (CONTINUOUS_STATES == 0 || x != NULL);
}

/* ---- Modes ---------------------------------------------------------------------------------------------------------- */

fmi2Status fmi2EnterEventMode(fmi2Component instance)
{
    Component *c = exchanging(instance, "fmi2EnterEventMode", EXCHANGING);
    if (c == NULL) {
        return fmi2Error;
    }
    c->memory.phase = EVENT;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component instance, fmi2EventInfo *info)
{
    const Component *c = exchanging(instance, "fmi2NewDiscreteStates", EVENT);
    if (c == NULL) {
        return fmi2Error;
    }
    if (info == NULL) {
        return refused(c, "fmi2NewDiscreteStates", "the event information is NULL");
    }
    memset(info, 0, sizeof *info); /* no event, and no end of the simulation */
    return fmi2OK;
}

/* Parameters are checked here, because continuous-time mode cannot change them. */
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component instance)
{
    Component *c = exchanging(instance, "fmi2EnterContinuousTimeMode", EVENT);
    if (c == NULL || (c->memory.stale & CHANGED && !fits(c, "fmi2EnterContinuousTimeMode"))) {
        return fmi2Error;
    }
    c->memory.stale = c->memory.stale ? MOVED : 0;
    c->memory.phase = CONTINUOUS;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component instance, fmi2Boolean final, fmi2Boolean *event_mode,
                                       fmi2Boolean *terminate)
{
    const Component *c = exchanging(instance, "fmi2CompletedIntegratorStep", CONTINUOUS);
    (void)final; /* states may be restored at any time */
    if (c == NULL) {
        return fmi2Error;
    }
    if (event_mode == NULL || terminate == NULL) {
        return refused(c, "fmi2CompletedIntegratorStep", "an address for a result is NULL");
    }
    *event_mode = fmi2False;
    *terminate = fmi2False;
    return fmi2OK;
}

/* ---- Time, states, derivatives -------------------------------------------------------------------------------------- */

/* Times after the stop time are accepted, because many integrators step over the end and interpolate back. */
fmi2Status fmi2SetTime(fmi2Component instance, fmi2Real time)
{
    Component *c = exchanging(instance, "fmi2SetTime", EXCHANGING);
    if (c == NULL) {
        return fmi2Error;
    }
    if (!is_finite(time)) {
        return refused(c, "fmi2SetTime", "the time is not finite");
    }
    c->memory.time = time;
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component instance, const fmi2Real x[], size_t n)
{
    Component *c = exchanging(instance, "fmi2SetContinuousStates", CONTINUOUS);
    if (c == NULL) {
        return fmi2Error;
    }
    if (!is_array_of_states(x, n)) {
        return refused_array(c, "fmi2SetContinuousStates");
    }
    for (size_t k = 0; k < n; k++) {
        if (!is_finite(x[k])) {
            return refused(c, "fmi2SetContinuousStates", "a state is not finite; the old values are kept");
        }
    }
    for (int k = 0; k < CONTINUOUS_STATES; k++) {
        *model_state(&c->memory, k) = x[k];
    }
    c->memory.stale |= CONTINUOUS_STATES > 0 ? MOVED : 0;
    return fmi2OK;
}

/* For a function that reads an array of numbers for the continuous states. */
static fmi2Status readable(Component *c, const char *function, const fmi2Real x[], size_t n)
{
    if (c == NULL) {
        return fmi2Error;
    }
    return is_array_of_states(x, n) ? updated(c, function) : refused_array(c, function);
}

fmi2Status fmi2GetContinuousStates(fmi2Component instance, fmi2Real x[], size_t n)
{
    Component *c = exchanging(instance, "fmi2GetContinuousStates", READABLE);
    const fmi2Status status = readable(c, "fmi2GetContinuousStates", x, n);
    for (int k = 0; k < CONTINUOUS_STATES && status == fmi2OK; k++) {
        x[k] = *model_state(&c->memory, k);
    }
    return status;
}

fmi2Status fmi2GetDerivatives(fmi2Component instance, fmi2Real derivatives[], size_t n)
{
    Component *c = exchanging(instance, "fmi2GetDerivatives", READABLE);
    const fmi2Status status = readable(c, "fmi2GetDerivatives", derivatives, n);
    int finite = 1;
    if (status != fmi2OK || n == 0) {
        return status;
    }
    model_derivatives(&c->memory, c->work, derivatives);
    for (int k = 0; k < CONTINUOUS_STATES; k++) {
        finite &= is_finite(derivatives[k]);
    }
    return finite ? fmi2OK : not_finite(c, "fmi2GetDerivatives");
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component instance, fmi2Real nominals[], size_t n)
{
    const Component *c = exchanging(instance, "fmi2GetNominalsOfContinuousStates", ALIVE);
    if (c == NULL) {
        return fmi2Error;
    }
    if (!is_array_of_states(nominals, n)) {
        return refused_array(c, "fmi2GetNominalsOfContinuousStates");
    }
    for (int k = 0; k < CONTINUOUS_STATES; k++) {
        nominals[k] = nominal_states[k];
    }
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component instance, fmi2Real indicators[], size_t n)
{
    const Component *c = exchanging(instance, "fmi2GetEventIndicators", READABLE);
    (void)indicators;
    if (c == NULL) {
        return fmi2Error;
    }
    return n == 0 ? fmi2OK : refused(c, "fmi2GetEventIndicators", "this FMU has no event indicators");
}
