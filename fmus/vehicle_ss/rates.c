/* Model exchange: the continuous states are the real parts of all modes, then the imaginary parts of the pairs. */
#include "modal.h"

/* The index of continuous state k in Modal.at. */
static int place_of_state(int k)
{
    return k < MODE_COUNT ? k : MODES + k - MODE_COUNT;
}

/* z' = lambda z + b u, with b u given. */
static void rates_of(const double *z, const Modal *w, double *rates)
{
    const double *x = z, *y = z + MODES;
    for (int k = 0; k < MODE_COUNT; k++) {
        rates[k] = SIGMA[k] * x[k] + w->at[k];
    }
    for (int k = 0; k < PAIR_COUNT; k++) {
        rates[k] -= OMEGA[k] * y[k];
        rates[MODE_COUNT + k] = SIGMA[k] * y[k] + OMEGA[k] * x[k] + w->at[MODES + k];
    }
}

/* The inputs' change by the friction's slope, for a change of the state. */
static void add_friction_change(const Memory *memory, const Modal *change, double *u)
{
    const Parameters *p = &memory->values.named.parameters;
    for (int i = 0; i < PORT_COUNT; i++) {
        const double v = row_times(C[PORT_OUTPUT[i]], memory->state);
        const double t = hyperbolic_tangent(v / p->friction_velocity[i]);
        const double slope = p->friction_force[i] / p->friction_velocity[i] * (1.0 - t * t);
        u[PORT_INPUT[i]] += slope * row_times(C[PORT_OUTPUT[i]], change->at);
    }
}

double *model_state(Memory *memory, int k)
{
    return memory->state + place_of_state(k);
}

int model_evaluate(Memory *memory, void *work, Message *why)
{
    Modal z;
    (void)work;
    (void)why;
    memset(&z, 0, sizeof z);
    memcpy(z.at, memory->state, STATE_COUNT * sizeof *memory->state);
    if (!is_sound(&z)) {
        return 0;
    }
    reach(memory, &z, has_friction(&memory->values.named.parameters));
    return 1;
}

void model_derivatives(const Memory *memory, void *work, double *rates)
{
    Modal w;
    (void)work;
    load(memory->state + REACHED, &w);
    rates_of(memory->state, &w, rates);
}

void model_tangent(const Memory *memory, void *work, const double *inputs, const double *states, double *outputs,
                   double *rates)
{
    double u[INPUTS];
    Modal change, w;
    (void)work;
    memcpy(u, inputs, sizeof u);
    memset(&change, 0, sizeof change);
    for (int k = 0; k < CONTINUOUS_STATES && states != NULL; k++) {
        change.at[place_of_state(k)] = states[k];
    }
    if (states != NULL) {
        add_friction_change(memory, &change, u);
    }
    for (int row = 0; row < OUTPUTS; row++) {
        double y = states == NULL ? 0.0 : row_times(C[row], change.at);
        for (int k = DIRECT_BEGIN[row]; k < DIRECT_BEGIN[row + 1]; k++) {
            y += DIRECT_TERM[k] * u[DIRECT_INPUT[k]];
        }
        outputs[row] = y;
    }
    if (rates != NULL) {
        load(u, &w);
        rates_of(change.at, &w, rates);
    }
}
