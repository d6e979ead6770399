/* The vehicle in several setups at once, from the files of its FMU, with the operations of its model.c. */
#include "vehicle.h"

#include "elementary_lanes.h"
#include "rest.h"
#include "vehicle_component.h"

#include "advance.h"

enum { KEPT = 8 };

static _Thread_local Factors kept[KEPT];
static _Thread_local int newest;

void forget_factors(void)
{
    memset(kept, 0, sizeof kept);
    newest = 0;
}

static const Factors *factors_of(const Car *car, double h)
{
    for (int k = 0; k < KEPT; k++) {
        if (kept[k].h == h) {
            return &kept[k];
        }
    }
    newest = (newest + 1) % KEPT;
    find_factors(car, &kept[newest], h);
    return &kept[newest];
}

static truth is_sound(const real *z)
{
    real sum[LANES] = {ZERO};
    for (int k = 0; k < MODE_ROWS; k++) {
        sum[k % LANES] += z[k] * z[k];
    }
    for (int k = 0; k < PAIR_ROWS; k++) {
        sum[k % LANES] += z[MODES + k] * z[MODES + k];
    }
    return (sum[0] + sum[2]) + (sum[1] + sum[3]) < LARGEST * LARGEST;
}

/* Saves a state; the padding stays zero. */
static void keep_state(Vehicle *vehicle, const Modal *state)
{
    memcpy(vehicle->z, state->at, MODE_ROWS * sizeof *state->at);
    memcpy(vehicle->z + MODES, state->at + MODES, PAIR_ROWS * sizeof *state->at);
}

/* Saves the inputs without forces of the ports, and adds these if there are any. */
static void reach(const Car *car, Vehicle *vehicle, const real *inputs, int has_forces)
{
    memcpy(vehicle->reached, inputs, sizeof vehicle->reached);
    if (has_forces) {
        add_port_forces(&car->parameters, vehicle->z, vehicle->bend, vehicle->reached);
    }
}

truth start_vehicle(const Car *car, Vehicle *vehicle, const real *inputs)
{
    truth found = {0};
    memset(vehicle, 0, sizeof *vehicle);
    for (int i = 0; i < SETUPS; i++) {
        double u[INPUTS], z[STATE_COUNT] = {0.0};
        for (int c = 0; c < INPUTS; c++) {
            u[c] = inputs[c][i];
        }
        found[i] = find_rest(car, u, z) ? -1 : 0;
        for (int k = 0; k < STATE_COUNT; k++) {
            vehicle->z[k][i] = z[k];
        }
    }
    this_car = car;
    reach(car, vehicle, inputs, has_port_forces(&car->parameters));
    return found;
}

static truth step_rubbing(const Car *car, Vehicle *vehicle, const real *from, const real *to, double h)
{
    const int count = count_sub_steps(car, h);
    const Factors *f = factors_of(car, h / (double)count);
    real u0[INPUTS], u1[INPUTS];
    Whole now;
    if (count == 0) {
        return (truth){0};
    }
    memcpy(now.z.at, vehicle->z, sizeof now.z.at);
    memcpy(now.bend, vehicle->bend, sizeof now.bend);
    memcpy(u0, from, sizeof u0);
    for (int k = 1; k <= count; k++) {
        interpolate(from, to, k == count ? 1.0 : (double)k / (double)count, u1);
        rub(&car->parameters, f, u0, u1, &now);
        memcpy(u0, u1, sizeof u0);
    }
    keep_state(vehicle, &now.z);
    memcpy(vehicle->bend, now.bend, sizeof vehicle->bend);
    return is_sound(vehicle->z);
}

truth step_vehicle(const Car *car, Vehicle *vehicle, const real *from, const real *to, double h)
{
    const int has_forces = has_port_forces(&car->parameters);
    truth sound;
    this_car = car;
    if (has_forces) {
        sound = step_rubbing(car, vehicle, from, to, h);
    } else {
        Modal w0, w1, end;
        load(from, &w0);
        load(to, &w1);
        advance(factors_of(car, h), vehicle->z, &w0, &w1, &end);
        keep_state(vehicle, &end);
        sound = is_sound(vehicle->z);
    }
    reach(car, vehicle, to, has_forces);
    return sound;
}

real vehicle_output(const Car *car, const Vehicle *vehicle, int output)
{
    real y = row_times(car->out[output], vehicle->z);
    for (int k = car->direct_begin[output]; k < car->direct_begin[output + 1]; k++) {
        y += car->direct[k] * vehicle->reached[car->direct_input[k]];
    }
    return car->has_offset[output] ? y + car->offset[output] : y;
}
