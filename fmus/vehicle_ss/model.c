/* vehicle_ss: x' = A x + B u, y = C x + D u, in real block-modal form: each mode is an independent equation z' = lambda z + b u,
 * with a complex z for a pair of eigenvalues and a real one for a real eigenvalue; y depends on the parts of all z, and on u.
 *
 * For inputs that change linearly from u0 to u1 over a step h the solution is exact at any h:
 *     z(h) = e^(lambda h) z + h (phi1 - phi2) b u0 + h phi2 b u1
 *     phi1(x) = (e^x - 1) / x,   phi2(x) = (phi1(x) - 1) / x
 * The forces of friction and springs at the ports (port_forces.h) are added to the shock forces. They are interpolated linearly over
 * each sub-step, from their values at the start to their values at the predicted end (second order; eightpost/vehicle/friction.py). */
#include <string.h>

#include "component.h"
#include "elementary.h"
#include "fresh.h"
#include "modal.h"
#include "phi.h"
#include "port_forces.h"
#include "steady_state.h"
#include "vehicle_data.h"

enum { KEPT = 4 };

/* Number of doublings for a mode's exponent lambda h; beyond 32, exp, sin and cos are used. */
enum { MOST_DOUBLINGS = 6 };

/* A sub-step is at most this share of the fastest time constant of the friction that creeps, and of a radian of the fastest swinging
 * on bristles and springs, with the stiffness of the springs at a displacement of SPRING_TRAVEL [m]. */
static const double SUB_STEP_SHARE = 0.0625, SUB_STEP_ANGLE = 0.125, SPRING_TRAVEL = 0.05;
static const double MOST_SUB_STEPS = 100000.0;

/* The factors of one step; kept for the last few step sizes, because a host's steps differ only by rounding. */
typedef struct {
    double h;
    double e_re[MODES], e_im[MODES]; /* e^(lambda h) */
    double first_re[MODES], first_im[MODES]; /* h (phi1 - phi2) */
    double second_re[MODES], second_im[MODES]; /* h phi2 */
} Factors;

/* The last two b u are kept too: most steps begin with the inputs with which the last one ended. */
typedef struct {
    Factors kept[KEPT];
    size_t newest;
    double input[INPUTS]; /* inputs of load[loaded] */
    size_t loaded;
    Modal load[2];
} Work;

/* ---- Factors of a step ---------------------------------------------------------------------------------------------- */

static void keep_factors(Factors *f, int first, const Exponentials *a)
{
    for (int i = 0; i < LANES; i++) {
        f->e_re[first + i] = a->e.re[i];
        f->e_im[first + i] = a->e.im[i];
        f->first_re[first + i] = f->h * (a->phi1.re[i] - a->phi2.re[i]);
        f->first_im[first + i] = f->h * (a->phi1.im[i] - a->phi2.im[i]);
        f->second_re[first + i] = f->h * a->phi2.re[i];
        f->second_im[first + i] = f->h * a->phi2.im[i];
    }
}

static Lanes exponents(int first, double h)
{
    Lanes x;
    for (int i = 0; i < LANES; i++) {
        x.re[i] = SIGMA[first + i] * h;
        x.im[i] = OMEGA[first + i] * h;
    }
    return x;
}

static void discretise(Factors *f, double h)
{
    int doublings = 0;
    double part = h;
    while (doublings <= MOST_DOUBLINGS && FASTEST * part > 0.5) {
        doublings++;
        part *= 0.5;
    }
    f->h = h;
    for (int first = 0; first < MODES; first += LANES) {
        const int is_large = doublings > MOST_DOUBLINGS;
        const Lanes x = exponents(first, is_large ? h : part);
        const Exponentials a = is_large ? exponentials_in_closed_form(&x) : exponentials_by_series(&x, doublings);
        keep_factors(f, first, &a);
    }
}

/* ---- A step --------------------------------------------------------------------------------------------------------- */

static const Factors *other_factors(Work *work, double h)
{
    for (size_t k = 0; k < KEPT; k++) {
        if (work->kept[k].h == h) {
            return &work->kept[k];
        }
    }
    work->newest = (work->newest + 1) % KEPT;
    discretise(&work->kept[work->newest], h);
    return &work->kept[work->newest];
}

static const Factors *factors(Work *work, double h)
{
    const Factors *last = &work->kept[work->newest];
    return last->h == h ? last : other_factors(work, h);
}

static int are_equal(const double *a, const double *b)
{
    for (int k = 0; k < INPUTS; k++) {
        if (a[k] != b[k]) {
            return 0;
        }
    }
    return 1;
}

/* b u at both ends of a step. */
static void load_ends(Work *work, const double *from, const double *to, const Modal **w0, const Modal **w1)
{
    Modal *begin = &work->load[work->loaded], *end = &work->load[1 - work->loaded];
    if (!are_equal(work->input, from)) { /* the initial zeros are consistent */
        copy_fresh(work->input, from, INPUTS);
        load(from, begin);
    }
    *w0 = *w1 = begin;
    if (!are_equal(from, to)) {
        copy_fresh(work->input, to, INPUTS);
        load(to, end);
        work->loaded = 1 - work->loaded;
        *w1 = end;
    }
}

/* z(h) from z, b u0 and b u1. */
static void advance(const Factors *restrict f, const double *restrict z, const Modal *restrict w0,
                    const Modal *restrict w1, Modal *restrict end)
{
    const double *x = z, *y = z + MODES, *a = w0->at, *b = w0->at + MODES, *c = w1->at, *d = w1->at + MODES;
    for (int k = 0; k < PAIRS; k++) {
        end->at[k] = (f->e_re[k] * x[k] - f->e_im[k] * y[k]) + (f->first_re[k] * a[k] - f->first_im[k] * b[k]) +
                     (f->second_re[k] * c[k] - f->second_im[k] * d[k]);
        end->at[MODES + k] = (f->e_re[k] * y[k] + f->e_im[k] * x[k]) +
                             (f->first_re[k] * b[k] + f->first_im[k] * a[k]) +
                             (f->second_re[k] * d[k] + f->second_im[k] * c[k]);
    }
    for (int k = PAIRS; k < MODES; k++) {
        end->at[k] = f->e_re[k] * x[k] + f->first_re[k] * a[k] + f->second_re[k] * c[k];
    }
}

/* ---- Friction and springs at the ports ------------------------------------------------------------------------------ */

/* 1/s: the sum over the ports of the friction's slope at zero velocity times the port's mobility. */
static double friction_rate(const Parameters *p)
{
    double rate = 0.0;
    for (int i = 0; i < PORT_COUNT; i++) {
        rate += p->friction_force[i] / p->friction_velocity[i] * MOBILITY[i];
    }
    return rate;
}

/* rad2/s2: the sum over the ports of the stiffness of bristle and spring times the port's mobility. */
static double squared_frequency(const Parameters *p)
{
    double stiffness[PORTS], sum = 0.0;
    for (int i = 0; i < PORT_COUNT; i++) {
        stiffness[i] = p->bristle_force[i] / p->bristle_reach[i];
    }
    for (int s = 0; s < SPRING_COUNT; s++) {
        stiffness[SPRING_PORT[s]] += 2.0 * SPRING_TRAVEL * magnitude(p->port_spring[s]);
    }
    for (int i = 0; i < PORT_COUNT; i++) {
        sum += stiffness[i] * MOBILITY[i];
    }
    return sum;
}

static int whole_number_above(double count)
{
    const int whole = (int)count;
    return whole < 1 ? 1 : whole + ((double)whole < count);
}

/* The number of sub-steps of a step; 0 if there are too many. */
static int sub_steps(const Parameters *p, double h)
{
    const double creeping = h * friction_rate(p) / SUB_STEP_SHARE, angle = h / SUB_STEP_ANGLE;
    const double square = angle * angle * squared_frequency(p);
    if (!(creeping >= 0.0 && creeping <= MOST_SUB_STEPS && square <= MOST_SUB_STEPS * MOST_SUB_STEPS)) {
        return 0;
    }
    int count = whole_number_above(creeping);
    while ((double)count * (double)count < square) { /* takes less time than the sub-steps */
        count++;
    }
    return count;
}

static void interpolate(const double *from, const double *to, double share, double *u)
{
    for (int i = 0; i < INPUTS; i++) {
        u[i] = from[i] + (to[i] - from[i]) * share;
    }
}

/* A state of the vehicle and of its bristles. */
typedef struct {
    Modal z;
    double bend[PORTS];
} Whole;

/* One sub-step with friction; u0 and u1 are the inputs at its ends. */
static void rub(const Parameters *p, const Factors *f, const double *u0, const double *u1, Whole *now)
{
    double start[INPUTS], end[INPUTS], force[PORTS], v0[PORTS], v1[PORTS], bent[PORTS] = {0.0};
    const int sticks = has_bristles(p);
    Modal w0, w1, predicted, corrected;
    memcpy(start, u0, sizeof start);
    memcpy(end, u1, sizeof end);
    port_velocities(now->z.at, v0);
    port_forces(p, now->z.at, v0, now->bend, force);
    add_to_inputs(force, start);
    add_to_inputs(force, end);
    load(start, &w0);
    load(end, &w1);
    advance(f, now->z.at, &w0, &w1, &predicted);
    port_velocities(predicted.at, v1);
    if (sticks) {
        bend_bristles(p, now->bend, v0, v1, f->h, bent);
    }
    memcpy(end, u1, sizeof end);
    port_forces(p, predicted.at, v1, bent, force);
    add_to_inputs(force, end);
    load(end, &w1);
    advance(f, now->z.at, &w0, &w1, &corrected);
    if (sticks) {
        port_velocities(corrected.at, v1);
        bend_bristles(p, now->bend, v0, v1, f->h, bent);
        memcpy(now->bend, bent, sizeof bent);
    }
    now->z = corrected;
}

static void step_with_friction(const Parameters *p, Work *work, const double *from, const double *to, double h, int count,
                               Whole *now)
{
    const Factors *f = factors(work, h / (double)count);
    double u0[INPUTS], u1[INPUTS];
    memcpy(u0, from, sizeof u0);
    for (int k = 1; k <= count; k++) {
        interpolate(from, to, k == count ? 1.0 : (double)k / (double)count, u1);
        rub(p, f, u0, u1, now);
        memcpy(u0, u1, sizeof u0);
    }
}

static void step_without_friction(Work *work, const double *from, const double *to, double h, const double *z, Modal *end)
{
    const Modal *w0, *w1;
    load_ends(work, from, to, &w0, &w1);
    advance(factors(work, h), z, w0, w1, end);
}

/* ---- Outputs -------------------------------------------------------------------------------------------------------- */

/* y = C z + D u + static state. */
double model_output(const Memory *memory, int output)
{
    const double *u = memory->state + REACHED;
    double y = row_times(C[output], memory->state);
    for (int k = DIRECT_BEGIN[output]; k < DIRECT_BEGIN[output + 1]; k++) {
        y += DIRECT_TERM[k] * u[DIRECT_INPUT[k]];
    }
    return OFFSET_OF[output] < 0 ? y : y + memory->values.named.parameters.offset[OFFSET_OF[output]];
}

/* Limits far below an overflow of an output or of the next step. */
static int is_sound(const Modal *z)
{
    double sum[LANES] = {0.0};
    for (int k = 0; k < STATE_COUNT; k += LANES) {
        for (int i = 0; i < LANES; i++) {
            sum[i] += z->at[k + i] * z->at[k + i];
        }
    }
    return (sum[0] + sum[2]) + (sum[1] + sum[3]) < LARGEST * LARGEST;
}

/* Saves state z, and the inputs there without forces of the ports. */
static void reach(Memory *memory, const Modal *z)
{
    memcpy(memory->state, z->at, STATE_COUNT * sizeof *z->at);
    copy_fresh(memory->state + REACHED, memory->values.named.signals.input, INPUTS);
}

/* The same with the forces of the ports, and the deflections. */
static void reach_with_friction(Memory *memory, const Whole *now)
{
    reach(memory, &now->z);
    memcpy(memory->state + BENT, now->bend, PORT_COUNT * sizeof *now->bend);
    add_port_forces(&memory->values.named.parameters, now->z.at, now->bend, memory->state + REACHED);
}

/* ---- Functions declared in component.h ------------------------------------------------------------------------------ */

size_t model_work_size(void)
{
    return sizeof(Work);
}

int model_refuses(const Values *v, Message *why)
{
    (void)v;
    (void)why;
    return 0;
}

int model_warns(const Values *v, Message *why)
{
    (void)v;
    (void)why;
    return 0;
}

int model_start(Memory *memory, void *work, Message *why)
{
    Whole now;
    const Parameters *p = &memory->values.named.parameters;
    (void)work;
    memset(&now, 0, sizeof now);
    if (memory->flag[start_at_equilibrium] && !HAS_EQUILIBRIUM) {
        say(why, "this vehicle has no unique steady state (a part of it is free to drift): set start_at_equilibrium to "
                 "false");
        return 0;
    }
    if (memory->flag[start_at_equilibrium] && !rest(p, memory->values.named.signals.input, &now.z, why)) {
        return 0;
    }
    memcpy(memory->state + BENT, now.bend, PORT_COUNT * sizeof *now.bend);
    if (has_port_forces(p)) {
        reach_with_friction(memory, &now);
    } else {
        reach(memory, &now.z);
    }
    return 1;
}

static int too_stiff(Message *why)
{
    say(why, "the friction is too stiff for a step of this length: use a smaller step, less friction_force, bristle_force or "
             "port_spring, or a larger friction_velocity or bristle_reach");
    return 0;
}

/* A step with forces of the ports. */
static int step_rubbing(Memory *memory, const double *from, double h, void *work, Message *why)
{
    Whole now;
    const Parameters *p = &memory->values.named.parameters;
    const int count = sub_steps(p, h);
    if (count == 0) {
        return too_stiff(why);
    }
    memcpy(now.z.at, memory->state, STATE_COUNT * sizeof *now.z.at);
    memcpy(now.bend, memory->state + BENT, PORT_COUNT * sizeof *now.bend);
    step_with_friction(p, (Work *)work, from, memory->values.named.signals.input, h, count, &now);
    if (!is_sound(&now.z)) {
        return 0;
    }
    reach_with_friction(memory, &now);
    return 1;
}

int model_step(Memory *memory, const double *from, double h, void *work, Message *why)
{
    Modal end;
    if (has_port_forces(&memory->values.named.parameters)) {
        return step_rubbing(memory, from, h, work, why);
    }
    step_without_friction((Work *)work, from, memory->values.named.signals.input, h, memory->state, &end);
    if (!is_sound(&end)) {
        return 0;
    }
    reach(memory, &end);
    return 1;
}
