/* A run of several setups at once: the equilibrium start of cosim/session/equilibrium.py, then the explicit Gauss-Seidel scheme with
 * parabolic values of cosim/engine, which is the default; the same operations in the same order. Measures are summed on the way. */
#include "march.h"

/* ---- Signals ------------------------------------------------------------------------------------------------------------ */

static void need_output(March *m, int output)
{
    if (!m->is_needed[output]) {
        m->is_needed[output] = 1;
        m->needed[m->needed_count++] = output;
    }
}

static void find_needed_outputs(March *m)
{
    for (int c = 0; c < CORNERS; c++) {
        need_output(m, m->run->velocity_output[c]);
        need_output(m, m->run->displacement_output[c]);
    }
    for (int w = 0; w < m->run->limit_count; w++) {
        need_output(m, m->run->limits[w].output);
    }
}

static void read_outputs(March *m)
{
    for (int k = 0; k < m->needed_count; k++) {
        m->output[m->needed[k]] = vehicle_output(m->run->car, &m->vehicle, m->needed[k]);
    }
}

/* ---- The equilibrium start ------------------------------------------------------------------------------------------------ */

enum { SWEEPS = 30 };
static const double TOLERANCE = 1e-12;

/* Evaluates the vehicle and then the shocks, each with the newest values, in setups that have not converged. */
static void sweep(March *m, truth moving)
{
    const Run *run = m->run;
    Vehicle vehicle;
    real inputs[INPUTS];
    for (int i = 0; i < INPUTS; i++) {
        const Input *in = &run->inputs[i];
        inputs[i] = uniform(in->constant);
        if (in->corner >= 0) {
            inputs[i] += m->force[in->corner].now + 0.0;
        }
        if (in->channel >= 0) {
            inputs[i] += in->factor * run->first_drive[in->channel] + in->offset;
        }
    }
    m->alive &= start_vehicle(run->car, &vehicle, inputs) | ~moving;
    for (size_t k = 0; k < sizeof vehicle / sizeof(real); k++) {
        real *to = (real *)&m->vehicle + k;
        *to = either(moving, ((const real *)&vehicle)[k], *to);
    }
    read_outputs(m);
    for (int c = 0; c < CORNERS; c++) {
        m->velocity[c].now = m->output[run->velocity_output[c]];
        m->displacement[c].now = m->output[run->displacement_output[c]];
        start_port(&m->ports[c], 0.0 + (m->velocity[c].now + 0.0), 0.0 + (m->displacement[c].now + 0.0));
        m->force[c].now = either(moving, m->ports[c].now.force, m->force[c].now);
    }
}

static real change_of(const Signal *signals, const real *before)
{
    real worst = uniform(0.0);
    for (int c = 0; c < CORNERS; c++) {
        const real change = size_of_number(signals[c].now - before[c]) / (size_of_number(before[c]) + 1.0);
        worst = either(change > worst, change, worst);
    }
    return worst;
}

static void copy_now(const Signal *signals, real *to)
{
    for (int c = 0; c < CORNERS; c++) {
        to[c] = signals[c].now;
    }
}

/* Returns in which setups inputs and outputs agree. */
static truth find_equilibrium(March *m, int64_t *sweeps)
{
    truth moving = ~(truth){0};
    for (int k = 0; k < SETUPS; k++) {
        sweeps[k] = 0;
    }
    sweep(m, moving);
    for (int n = 2; n < SWEEPS && in_any(moving); n++) {
        real force[CORNERS], velocity[CORNERS], displacement[CORNERS], worst;
        copy_now(m->force, force);
        copy_now(m->velocity, velocity);
        copy_now(m->displacement, displacement);
        sweep(m, moving);
        worst = change_of(m->force, force);
        worst = larger_of(worst, change_of(m->velocity, velocity));
        worst = larger_of(worst, change_of(m->displacement, displacement));
        for (int k = 0; k < SETUPS; k++) {
            if (moving[k] && worst[k] <= TOLERANCE) {
                sweeps[k] = n;
                moving[k] = 0;
            }
        }
    }
    return ~moving;
}

/* ---- A coupling step ------------------------------------------------------------------------------------------------------- */

static Step step_from(const March *m, int64_t k)
{
    const double h = m->run->steps[k];
    const int again = h == m->last[0];
    const double bend = again && h == m->last[1] ? h : h * (h + m->last[0]) / (m->last[0] + m->last[1]);
    const Step step = {
        .size = h,
        .per_second = again ? m->pace[0] : 1.0 / h,
        .line = h * m->pace[0],
        .newer = (h + bend) * m->pace[0],
        .older = bend * m->pace[1],
        .sag = again ? 1.0 / 6.0 : h / (3.0 * (h + m->last[0])),
        .first = m->run->begins[k],
        .last = m->run->begins[k + 1],
    };
    return step;
}

/* The start of a straight line to `end` with the mean of a parabola through the last step's start. */
static real start_of_line(const Signal *s, real end, const Step *step)
{
    return s->now - (end - s->now - (s->now - s->past) * step->line) * step->sag;
}

/* What is given to the other side of the bond: its value at the start, its slope, and for the sums its mean and its end. */
static Line line_to(const Signal *s, real end, const Step *step)
{
    const real a = start_of_line(s, end, step) + 0.0, b = end + 0.0;
    const Line line = {a, (b - a) * step->per_second, 0.5 * a + 0.5 * b, b};
    return line;
}

static real on_parabola(const Signal *s, const Step *step)
{
    return s->now + (s->now - s->past) * step->newer - (s->past - s->older) * step->older;
}

static void feed_vehicle(March *m, const Step *step, real *start, real *rate)
{
    const Run *run = m->run;
    const double *x = run->starts + step->first * run->drive_channels, *y = run->samples + step->last * run->drive_channels;
    for (int i = 0; i < INPUTS; i++) {
        const Input *in = &run->inputs[i];
        real value = uniform(in->constant), slope = uniform(0.0);
        if (in->corner >= 0) {
            const Signal *s = &m->force[in->corner];
            const real a = start_of_line(s, on_parabola(s, step), step) + 0.0, b = on_parabola(s, step) + 0.0;
            const Line line = {a, a, 0.5 * a + 0.5 * b, b};
            value += a;
            slope += (b - a) * step->per_second;
            m->force_line[in->corner] = line;
        }
        if (in->channel >= 0) {
            value += in->factor * x[in->channel] + in->offset;
            slope += in->factor * (y[in->channel] - x[in->channel]) * step->per_second;
        }
        start[i] = value;
        rate[i] = slope;
    }
}

static truth go(March *m, const Step *step, const real *start, const real *rate)
{
    real to[INPUTS];
    for (int i = 0; i < INPUTS; i++) {
        to[i] = start[i] + rate[i] * step->size;
    }
    return step_vehicle(m->run->car, &m->vehicle, start, to, step->size);
}

/* The inputs at the drive's point j: on their straight lines, with the drive's value there. */
static void value_between(const Run *run, const Step *step, const real *start, const real *rate, int64_t j, real *to)
{
    const int64_t n = run->drive_channels, first = step->first, last = step->last;
    const double *t = run->drive_times, share = (t[j] - t[first]) / (t[last] - t[first]);
    for (int i = 0; i < INPUTS; i++) {
        const int d = run->inputs[i].channel;
        to[i] = start[i] + rate[i] * (step->size * share);
        if (d >= 0) {
            const double *s = run->samples, line = s[first * n + d] + (s[last * n + d] - s[first * n + d]) * share;
            to[i] += run->inputs[i].factor * (s[j * n + d] - line);
        }
    }
}

/* Steps the vehicle from each of the drive's points to the next. */
static truth follow(March *m, const Step *step, const real *start, const real *rate)
{
    const Run *run = m->run;
    truth sound = ~(truth){0};
    for (int64_t j = step->first; j < step->last; j++) {
        const double h = run->drive_times[j + 1] - run->drive_times[j], per_second = 1.0 / h;
        real from[INPUTS], to[INPUTS];
        value_between(run, step, start, rate, j, from);
        value_between(run, step, start, rate, j + 1, to);
        for (int i = 0; i < INPUTS; i++) {
            to[i] = from[i] + ((to[i] - from[i]) * per_second) * h;
        }
        sound &= step_vehicle(run->car, &m->vehicle, from, to, h);
    }
    return sound;
}

static void step_shocks(March *m, const Step *step)
{
    for (int c = 0; c < CORNERS; c++) {
        const Line v = line_to(&m->velocity[c], m->velocity[c].ahead, step);
        const Line d = line_to(&m->displacement[c], m->displacement[c].ahead, step);
        m->velocity_line[c] = v;
        step_port(&m->ports[c], v.start, v.start + v.rate * step->size, d.start + d.rate * step->size, step->size, m->alive);
        m->force[c].ahead = m->ports[c].now.force;
    }
}

static truth step_vehicle_of(March *m, const Step *step)
{
    const Run *run = m->run;
    real start[INPUTS], rate[INPUTS];
    truth sound;
    feed_vehicle(m, step, start, rate);
    sound = run->follows && step->last > step->first + 1 ? follow(m, step, start, rate) : go(m, step, start, rate);
    read_outputs(m);
    for (int c = 0; c < CORNERS; c++) {
        m->velocity[c].ahead = m->output[run->velocity_output[c]];
        m->displacement[c].ahead = m->output[run->displacement_output[c]];
    }
    return sound;
}

/* ---- The run ---------------------------------------------------------------------------------------------------------------- */

static void accept(March *m, const Step *step)
{
    m->last[1] = m->last[0];
    m->pace[1] = m->pace[0];
    m->last[0] = step->size;
    m->pace[0] = step->per_second;
    for (int c = 0; c < CORNERS; c++) {
        m->force[c].older = m->force[c].past;
        shift(&m->velocity[c]);
        shift(&m->displacement[c]);
        shift(&m->force[c]);
    }
}

static real square(real x)
{
    return x * x;
}

/* Where signals are far below an overflow. Their norm is compared with the limit of each in cosim/engine/march.py: a setup between the
 * two runs through the FMUs, which decide. */
static truth are_sensible(const March *m)
{
    real sum = uniform(0.0);
    for (int c = 0; c < CORNERS; c++) {
        sum += square(m->velocity[c].ahead) + square(m->displacement[c].ahead) + square(m->force[c].ahead);
    }
    for (int w = 0; w < m->run->limit_count; w++) {
        sum += square(m->output[m->run->limits[w].output]);
    }
    return sum < DIVERGED * DIVERGED;
}

/* Puts a number in place of the whole state of setups that are no longer finite: computing with infinities is slow. */
static void retire(March *m, truth ended, int64_t step, int64_t *at)
{
    real *state = (real *)&m->vehicle;
    for (size_t k = 0; k < sizeof m->vehicle / sizeof(real); k++) {
        state[k] = either(ended, uniform(0.0), state[k]);
    }
    for (int k = 0; k < OUTPUTS; k++) {
        m->output[k] = either(ended, uniform(0.0), m->output[k]);
    }
    for (int c = 0; c < CORNERS; c++) {
        Signal *all[] = {&m->velocity[c], &m->displacement[c], &m->force[c]};
        for (int k = 0; k < 3; k++) {
            real *s = (real *)all[k];
            for (int n = 0; n < 4; n++) {
                s[n] = either(ended, uniform(0.0), s[n]);
            }
        }
        m->ports[c].lagged = either(ended, uniform(0.0), m->ports[c].lagged);
        m->ports[c].travel = either(ended, uniform(0.0), m->ports[c].travel);
    }
    for (int k = 0; k < SETUPS; k++) {
        if (ended[k] && m->alive[k]) {
            at[k] = step;
        }
    }
    m->alive &= ~ended;
}

static void march(March *m, const Sums *sums)
{
    const Run *run = m->run;
    for (int64_t k = 0; k < run->steps_count && in_any(m->alive); k++) {
        const Step step = step_from(m, k);
        truth sound = step_vehicle_of(m, &step);
        step_shocks(m, &step);
        sound &= are_sensible(m);
        if (!in_every(sound)) {
            retire(m, ~sound, k, sums->ended);
        }
        add_bonds(m, &step);
        if (run->times[k + 1] > run->settling) {
            add_limits(m, &step);
        }
        accept(m, &step);
        if (run->recorded[k + 1] == 1) {
            record(m, sums);
        }
    }
}

/* The size of the data of a batch, and of its Port; for Python. */
EXPORTED int64_t size_of_batch(void)
{
    return (int64_t)sizeof(March);
}

EXPORTED int64_t number_of_parameters(void)
{
    return PARAMETERS;
}

EXPORTED int64_t number_of_setups(void)
{
    return SETUPS;
}

EXPORTED int64_t size_of_car(void)
{
    return (int64_t)sizeof(Car);
}

/* Runs a batch. `parameters` (CORNERS, PARAMETERS, SETUPS) and `laws` (CORNERS, SETUPS) are those of the shocks; `space` is for the
 * data of the batch, at a multiple of 64. */
EXPORTED void run_batch(const Run *run, const double *parameters, const int64_t *laws, void *space, const Sums *sums)
{
    March *m = (March *)space;
    memset(m, 0, offsetof(March, ports));
    m->run = run;
    m->alive = ~(truth){0};
    for (int c = 0; c < CORNERS; c++) {
        Port *port = &m->ports[c];
        memcpy(&port->parameters, parameters + (size_t)c * PARAMETERS * SETUPS, sizeof port->parameters);
        memcpy(&port->law, laws + (size_t)c * SETUPS, sizeof port->law);
    }
    for (int k = 0; k < SETUPS; k++) {
        sums->ended[k] = -1;
    }
    forget_factors();
    find_needed_outputs(m);
    m->last[0] = m->last[1] = 1e300;
    m->pace[0] = m->pace[1] = 1e-300;
    const truth found = find_equilibrium(m, sums->sweeps);
    retire(m, ~(found & m->alive), 0, sums->ended);
    m->alive &= found;
    for (int k = 0; k < SETUPS; k++) {
        sums->ended[k] = m->alive[k] ? -1 : 0;
    }
    begin_signals(m);
    record(m, sums);
    march(m, sums);
    report(m, sums);
}
