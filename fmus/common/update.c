/* Outputs and state after a change of parameters, inputs or states. */
#include "calls.h"

int fits(const Component *c, const char *function)
{
    Message why = {.length = 0};
    if (model_refuses(&c->memory.values, &why)) {
        refused(c, function, why.text);
        return 0;
    }
    if (model_warns(&c->memory.values, &why)) {
        logged(c, fmi2Warning, why.text);
    }
    return 1;
}

/* Called in initialization mode, and once more at its end. */
int started(Component *c, const char *function)
{
    Message why = {.length = 0};
    Memory trial = c->memory;
    if (!fits(c, function)) {
        return 0;
    }
    if (!model_start(&trial, c->work, &why) || !signals_are_finite(&trial)) {
        refused(c, function, why.length > 0 ? why.text : "the start is not finite: check inputs and parameters");
        return 0;
    }
    c->memory = trial;
    c->memory.stale = 0;
    return 1;
}

fmi2Status not_finite(const Component *c, const char *function)
{
    Message message = {.length = 0};
    say(&message, function);
    say(&message, ": a result is not finite at these inputs and states: take a smaller step");
    logged(c, fmi2Discard, message.text);
    return fmi2Discard;
}

/* In model exchange. */
static fmi2Status evaluated(Component *c, const char *function)
{
    Message why = {.length = 0};
    if (c->memory.stale & CHANGED && !fits(c, function)) {
        return fmi2Error;
    }
    if (!model_evaluate(&c->memory, c->work, &why)) {
        return not_finite(c, function);
    }
    c->memory.stale = 0;
    return fmi2OK;
}

/* In initialization mode and in model exchange, update outputs after changes; a message if that is not possible. */
fmi2Status updated(Component *c, const char *function)
{
    if (!c->memory.stale || !(c->memory.phase & (INITIALIZING | EXCHANGING))) {
        return fmi2OK;
    }
    if (c->memory.phase == INITIALIZING) {
        return started(c, function) ? fmi2OK : fmi2Error;
    }
    return evaluated(c, function);
}
