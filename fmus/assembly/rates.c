/* Model exchange: the continuous states are those of all parts. The vehicle's outputs that feed the shocks have no feedthrough from
 * the forces, so an evaluation in order has no loop: the vehicle, the shocks, and the vehicle again with their forces. Nothing is
 * extrapolated. */
#include <string.h>

#include "machine.h"
#include "part_kinds.h"

int evaluate_part(Machine *m, int p, const double *outside, Message *why)
{
    double from[MOST_INPUTS];
    Message message = {.length = 0};
    feed(m, p, outside, outside, 1.0, from, m->values[p]);
    memcpy(m->values[p], from, (size_t)PART[p].input_count * sizeof *from);
    if (!evaluate(PART[p].kind, m->part[p], &message)) {
        add_part_message(p, &message, why);
        return 0;
    }
    read_part(m, p);
    for (int s = PART[p].signals; s < PART[p].signals + PART[p].signal_count; s++) {
        m->now[s] = m->ahead[s];
    }
    return 1;
}

double *model_state(Memory *memory, int k)
{
    return &memory->state[STATE_PLACE[k]];
}

int model_evaluate(Memory *memory, void *work, Message *why)
{
    Machine m;
    const double *outside = memory->values.named.signals.input;
    unpack(&m, memory, work);
    memcpy(m.ahead, m.now, sizeof m.ahead);
    memset(m.slope, 0, sizeof m.slope);
    for (int p = 0; p < PARTS; p++) {
        if (!evaluate_part(&m, p, outside, why)) {
            return 0;
        }
    }
    if (!evaluate_part(&m, 0, outside, why)) {
        return 0;
    }
    pack(&m, memory);
    return 1;
}

void model_derivatives(const Memory *memory, void *work, double *rates)
{
    Machine m;
    unpack(&m, memory, work);
    for (int p = 0; p < PARTS; p++) {
        compute_derivatives(PART[p].kind, m.part[p], rates + PART[p].states);
    }
}

/* The directions of a tangent, and the resulting changes of the coupled signals. */
typedef struct {
    const double *inputs, *states;
    double *outputs, *rates;
    double moved[COUPLED];
} Tangent;

static void change_part(const Machine *m, int p, Tangent *t)
{
    double u[MOST_INPUTS] = {0.0};
    double *outputs = t->outputs + (PART[p].outputs - INPUTS);
    for (int i = 0; i < PART[p].input_count; i++) {
        const Feed *fed = &FEED[PART[p].feeds + i];
        u[i] = fed->outside >= 0 ? t->inputs[fed->outside] : 0.0;
        for (int k = fed->first; k < fed->last; k++) {
            u[i] += TERM[k].gain * TERM[k].factor * t->moved[TERM[k].signal];
        }
    }
    compute_tangent(PART[p].kind, m->part[p], u, t->states == NULL ? NULL : t->states + PART[p].states, outputs,
                    t->rates == NULL ? NULL : t->rates + PART[p].states);
    for (int s = PART[p].signals; s < PART[p].signals + PART[p].signal_count; s++) {
        t->moved[s] = outputs[SIGNAL[s].output];
    }
}

/* Between steps of co-simulation a change of a force reaches the vehicle with the next step only. */
void model_tangent(const Memory *memory, void *work, const double *inputs, const double *states, double *outputs,
                   double *rates)
{
    Machine m;
    Tangent t = {.inputs = inputs, .states = states, .outputs = outputs, .rates = rates};
    unpack(&m, memory, work);
    memset(outputs, 0, OUTPUTS * sizeof *outputs); /* error estimates have no derivatives */
    for (int p = 0; p < PARTS; p++) {
        change_part(&m, p, &t);
    }
    if (memory->phase != STEPPING) {
        change_part(&m, 0, &t);
    }
}
