/* Model exchange: the continuous states are the real parts of all modes, the imaginary parts of the pairs, and the deflections of the
 * bristles. */
#include "modal.h"
#include "port_forces.h"

/* Number of continuous states of the modes. */
enum { MODAL_STATES = MODE_COUNT + PAIR_COUNT };

/* The index of continuous state k in Memory.state; below MODAL_STATES it is that in Modal.at. */
static int place_of_state(int k)
{
    if (k >= MODAL_STATES) {
        return BENT + k - MODAL_STATES;
    }
    return k < MODE_COUNT ? k : MODES + k - MODE_COUNT;
}

/* z' = lambda z + b u, or that of the coupled states, with b u given. */
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
    for (int r = 0; r < COUPLED_COUNT; r++) {
        rates[FIRST_COUPLED + r] += coupled_row(COUPLING + r * COUPLED, z);
    }
}

/* z' = v - |v| z / z_b(v) of the bristles; one without force rests. */
static void bristle_rates(const Parameters *p, const double *v, const double *bend, double *rates)
{
    for (int i = 0; i < PORT_COUNT; i++) {
        const double speed = v[i] < 0.0 ? -v[i] : v[i];
        rates[i] = p->bristle_force[i] > 0.0 ? v[i] - speed * bend[i] / sliding_deflection(p, i, v[i]) : 0.0;
    }
}

/* A small change of a state: of modes, and of deflections. */
typedef struct {
    Modal z;
    double bend[PORTS];
} Change;

/* The inputs' change by the slopes of friction and springs, for a change of the state. */
static void add_force_change(const Memory *memory, const Change *change, const double *dv, double *u)
{
    const Parameters *p = &memory->values.named.parameters;
    for (int i = 0; i < PORT_COUNT; i++) {
        if (p->friction_force[i] > 0.0) {
            const double v = row_times(C[PORT_OUTPUT[i]], memory->state);
            const double t = hyperbolic_tangent(v / p->friction_velocity[i]);
            const double slope = p->friction_force[i] / p->friction_velocity[i] * (1.0 - t * t);
            u[PORT_INPUT[i]] += slope * dv[i];
        }
        u[PORT_INPUT[i]] += p->bristle_force[i] / p->bristle_reach[i] * change->bend[i];
    }
    for (int s = 0; s < SPRING_COUNT; s++) {
        if (p->port_spring[s] != 0.0) {
            const double d = row_times(C[SPRING_OUTPUT[s]], memory->state);
            u[PORT_INPUT[SPRING_PORT[s]]] +=
                2.0 * p->port_spring[s] * d * row_times(C[SPRING_OUTPUT[s]], change->z.at);
        }
    }
}

/* The change of z' of the bristles. At v = 0, where |v| has a kink, it is the mean of both sides. */
static void change_bristle_rates(const Memory *memory, const Change *change, const double *dv, double *rates)
{
    const Parameters *p = &memory->values.named.parameters;
    for (int i = 0; i < PORT_COUNT; i++) {
        const double v = row_times(C[PORT_OUTPUT[i]], memory->state), z = memory->state[BENT + i];
        const double side = v > 0.0 ? 1.0 : v < 0.0 ? -1.0 : 0.0, limit = sliding_deflection(p, i, v);
        const double stribeck = p->bristle_stribeck_velocity[i];
        const double fall = -2.0 * v / (stribeck * stribeck) * p->bristle_reach[i] * static_excess_at(p, i, v); /* dz_b/dv */
        rates[i] = 0.0;
        if (p->bristle_force[i] > 0.0) {
            rates[i] = (1.0 - side * z / limit + side * v * z * fall / (limit * limit)) * dv[i] -
                       side * v / limit * change->bend[i];
        }
    }
}

double *model_state(Memory *memory, int k)
{
    return &memory->state[place_of_state(k)];
}

static int is_in_limits(double x)
{
    return x >= -LARGEST && x <= LARGEST;
}

/* The state stays; the inputs there include the forces of the ports. */
int model_evaluate(Memory *memory, void *work, Message *why)
{
    const Parameters *p = &memory->values.named.parameters;
    const double *bend = memory->state + BENT;
    double u[INPUTS], v[PORTS], force[PORTS], rates[PORTS];
    int finite = 1;
    (void)work;
    (void)why;
    memcpy(u, memory->values.named.signals.input, sizeof u);
    port_velocities(memory->state, v);
    port_forces(p, memory->state, v, bend, force);
    add_to_inputs(force, u);
    bristle_rates(p, v, bend, rates);
    for (int i = 0; i < INPUTS; i++) {
        finite &= is_in_limits(u[i]);
    }
    for (int k = 0; k < STATE_COUNT; k++) {
        finite &= is_in_limits(memory->state[k]);
    }
    for (int i = 0; i < PORT_COUNT; i++) { /* products of a velocity and a deflection */
        finite &= is_in_limits(bend[i]);
        finite &= is_finite(rates[i]);
    }
    if (finite) {
        memcpy(memory->state + REACHED, u, sizeof u);
    }
    return finite;
}

void model_derivatives(const Memory *memory, void *work, double *rates)
{
    Modal w;
    double v[PORTS];
    (void)work;
    load(memory->state + REACHED, &w);
    rates_of(memory->state, &w, rates);
    port_velocities(memory->state, v);
    bristle_rates(&memory->values.named.parameters, v, memory->state + BENT, rates + MODAL_STATES);
}

/* Places a direction of the continuous states. */
static void take_change(const double *states, Change *change)
{
    memset(change, 0, sizeof *change);
    for (int k = 0; k < CONTINUOUS_STATES; k++) {
        if (k < MODAL_STATES) {
            change->z.at[place_of_state(k)] = states[k];
        } else {
            change->bend[k - MODAL_STATES] = states[k];
        }
    }
}

void model_tangent(const Memory *memory, void *work, const double *inputs, const double *states, double *outputs,
                   double *rates)
{
    double u[INPUTS], dv[PORTS] = {0.0};
    Change change;
    Modal w;
    (void)work;
    memcpy(u, inputs, sizeof u);
    memset(&change, 0, sizeof change);
    if (states != NULL) {
        take_change(states, &change);
        port_velocities(change.z.at, dv);
        add_force_change(memory, &change, dv, u);
    }
    for (int row = 0; row < OUTPUTS; row++) {
        double y = states == NULL ? 0.0 : row_times(C[row], change.z.at);
        for (int k = DIRECT_BEGIN[row]; k < DIRECT_BEGIN[row + 1]; k++) {
            y += DIRECT_TERM[k] * u[DIRECT_INPUT[k]];
        }
        outputs[row] = y;
    }
    if (rates != NULL) {
        load(u, &w);
        rates_of(change.z.at, &w, rates);
        change_bristle_rates(memory, &change, dv, rates + MODAL_STATES);
    }
}
