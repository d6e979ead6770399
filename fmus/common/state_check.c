/* Checks whether a deserialized memory is one that an instance of this FMU can have. A checksum detects damage, but anyone can
 * compute one, so every number is checked before a step uses it. */
#include <string.h>

#include "elementary.h"
#include "calls.h"

static int not_possible(Message *why, const char *what)
{
    say(why, "this state is not valid for this FMU: ");
    say(why, what);
    return 0;
}

static int are_finite(const double *numbers, size_t count)
{
    int finite = 1;
    for (size_t k = 0; k < count; k++) {
        finite &= is_finite(numbers[k]);
    }
    return finite;
}

static int is_phase(int64_t phase, int is_model_exchange)
{
    return phase == INSTANTIATED || phase == INITIALIZING || phase == TERMINATED ||
           (is_model_exchange ? phase == EVENT || phase == CONTINUOUS : phase == STEPPING);
}

static int is_truth(int64_t value)
{
    return value == 0 || value == 1;
}

static int are_truths(const Memory *m, int is_model_exchange)
{
    int truths = m->stale >= 0 && m->stale <= (is_model_exchange ? CHANGED | MOVED : CHANGED);
    for (int k = 0; k < FLAGS; k++) {
        truths &= is_truth(m->flag[k]);
    }
    return truths;
}

/* Settable values must be in their range; values that the host cannot set must be as at the start. */
static int parameters_are_possible(const Memory *m, Message *why)
{
    unsigned char is_seen[REALS] = {0};
    for (fmi2ValueReference reference = 0; reference < REFERENCES; reference++) {
        const Variable *v = find_variable(reference);
        if (v == NULL || v->kind != REAL || v->index >= REALS) {
            continue;
        }
        is_seen[v->index] = 1;
        if (v->index >= SIGNALS && !(m->values.at[v->index] >= v->minimum && m->values.at[v->index] <= v->maximum)) {
            not_possible(why, v->name);
            say(why, " is out of its range");
            return 0;
        }
    }
    for (int k = SIGNALS; k < REALS; k++) {
        if (!is_seen[k] && m->values.at[k] != start_values[k]) {
            return not_possible(why, "a parameter that cannot be set has another value");
        }
    }
    return 1;
}

int is_possible(const Memory *m, int is_model_exchange, Message *why)
{
    if (!is_phase(m->phase, is_model_exchange)) {
        return not_possible(why, "its phase is unknown");
    }
    if (!are_truths(m, is_model_exchange)) {
        return not_possible(why, "a Boolean is neither true nor false");
    }
    if (!is_finite(m->time) || !is_finite(m->stop) || !are_finite(m->slope, INPUTS) || !are_finite(m->state, STATES) ||
        !are_finite(m->values.at, REALS) || !signals_are_finite(m)) {
        return not_possible(why, "a number is not finite");
    }
    if (!parameters_are_possible(m, why)) {
        return 0;
    }
    /* Parameters that have not been checked yet are checked before the next step. */
    return m->stale || !model_refuses(&m->values, why);
}
