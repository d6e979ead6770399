/* fmi2DoStep: the checks around a model's step, and queries about steps. */
#include <string.h>

#include "calls.h"
#include "elementary.h"
#include "fresh.h"
#include "wide.h"

/* Hosts add up their time, so a difference of this size is rounding; for a large time, this share of it. */
static const double ROUNDING = 1e-9;

static double rounding(double time)
{
    const double size = time < 0.0 ? -time : time;
    return ROUNDING * (size > 1.0 ? size : 1.0);
}

static fmi2Status bad_step(const Component *c, const char *what, double first, const char *then, double second)
{
    Message message = {.length = 0};
    say(&message, what);
    say_number(&message, first);
    say(&message, then);
    say_number(&message, second);
    say(&message, " s");
    return refused(c, "fmi2DoStep", message.text);
}

static fmi2Status checked_step(const Component *c, double time, double h)
{
    const Memory *m = &c->memory;
    if (!is_finite(time) || !is_finite(h) || h <= 0.0) {
        return bad_step(c, "the step must be positive and finite; it is ", h, " s, from ", time);
    }
    if (time - m->time > rounding(time) || m->time - time > rounding(time)) {
        return bad_step(c, "the step begins at ", time, " s, but the last one ended at ", m->time);
    }
    if (time + h - m->stop > rounding(m->stop)) {
        return bad_step(c, "the step would end at ", time + h, " s, after the stop time of ", m->stop);
    }
    return fmi2OK;
}

/* The usual call: from the end of the last step, and not beyond the stop time. */
static int goes_on(const Memory *m, double time, double h)
{
    const double apart = time - m->time;
    return h > 0.0 && apart <= ROUNDING && apart >= -ROUNDING && time + h <= m->stop;
}

int is_next_step(const Component *c, double time, double h)
{
    return goes_on(&c->memory, time, h) || checked_step(c, time, h) == fmi2OK;
}

static int may_step(const Component *c, double time, double h)
{
    return is_next_step(c, time, h) && (!c->memory.stale || fits(c, "fmi2DoStep"));
}

/* Moves the inputs to the end of the step with their derivatives, which apply to one step. */
static void carry_inputs(Memory *m, double h, double *from)
{
    for (int k = 0; k < INPUTS; k++) {
        from[k] = fresh(m->values.at + k);
        m->values.at[k] = from[k] + fresh(m->slope + k) * h;
    }
}

static fmi2Status discarded(Component *c, const double *from, const Message *why)
{
    memcpy(c->memory.values.at, from, INPUTS * sizeof *from);
    logged(c, fmi2Discard, why->length > 0 ? why->text : "fmi2DoStep: the result is not finite; the step was not made");
    return fmi2Discard;
}

fmi2Status fmi2DoStep(fmi2Component instance, fmi2Real time, fmi2Real h, fmi2Boolean final)
{
    GO_ON_WIDE(instance, fmi2DoStep(instance, time, h, final));
    Component *c = entered(instance, "fmi2DoStep", STEPPING);
    Message why;
    double from[INPUTS];
    why.length = 0; /* the text itself need not be initialized */
    (void)final; /* states may be restored at any time */
    if (c == NULL || !may_step(c, time, h)) {
        return fmi2Error;
    }
    carry_inputs(&c->memory, h, from);
    if (!model_step(&c->memory, from, h, c->work, &why)) {
        return discarded(c, from, &why);
    }
    memset(c->memory.slope, 0, sizeof c->memory.slope);
    c->memory.stale = 0;
    c->memory.time = time + h;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component instance)
{
    const Component *c = (const Component *)instance;
    return c == NULL ? fmi2Error : refused(c, "fmi2CancelStep", "no step is ever pending");
}

static fmi2Status not_offered(fmi2Component instance, const char *function)
{
    const Component *c = entered(instance, function, STEPPING | TERMINATED);
    if (c == NULL) {
        return fmi2Error;
    }
    logged(c, fmi2Discard, "no step is ever pending, so there is no such status");
    return fmi2Discard;
}

fmi2Status fmi2GetStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind;
    (void)value;
    return not_offered(instance, "fmi2GetStatus");
}

fmi2Status fmi2GetRealStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Real *value)
{
    const Component *c = entered(instance, "fmi2GetRealStatus", STEPPING | TERMINATED);
    if (c == NULL || kind != fmi2LastSuccessfulTime || value == NULL) {
        return c == NULL ? fmi2Error : not_offered(instance, "fmi2GetRealStatus");
    }
    *value = c->memory.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)kind;
    (void)value;
    return not_offered(instance, "fmi2GetIntegerStatus");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2Boolean *value)
{
    const Component *c = entered(instance, "fmi2GetBooleanStatus", STEPPING | TERMINATED);
    if (c == NULL || kind != fmi2Terminated || value == NULL) {
        return c == NULL ? fmi2Error : not_offered(instance, "fmi2GetBooleanStatus");
    }
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component instance, const fmi2StatusKind kind, fmi2String *value)
{
    (void)kind;
    (void)value;
    return not_offered(instance, "fmi2GetStringStatus");
}
