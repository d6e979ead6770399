/* vehicle_ss: x' = A x + B u, y = C x + D u, in real block-modal form: each mode is z' = lambda z + b u by itself, with a
 * complex z for a pair of eigenvalues and a real one for a real eigenvalue; y follows the parts of all z, and u.
 *
 * With inputs that go linearly from u0 to u1 over a step h the solution is exact at any h:
 *     z(h) = e^(lambda h) z + h (phi1 - phi2) b u0 + h phi2 b u1
 *     phi1(x) = (e^x - 1) / x,   phi2(x) = (phi1(x) - 1) / x
 * Suspension friction at a port, F_c tanh(v / v_f), adds to the shock force there. It goes linearly over each sub-step, from
 * its value at the start to its value at the predicted end (second order; eightpost/vehicle/friction.py). */
#include <string.h>

#include "component.h"
#include "elementary.h"
#include "phi.h"
#include "vehicle_data.h"

enum { KEPT = 4 };

/* Of a mode's exponent lambda h; beyond 32 by exp, sin and cos. */
enum { MOST_DOUBLINGS = 6 };

/* A sub-step is at most this share of the friction's fastest time constant. */
static const double SUB_STEP_SHARE = 0.25;
static const double MOST_SUB_STEPS = 100000.0;

/* No state is ever so large, in any unit. */
static const double LARGEST = 1e150;

/* The factors of one step; kept for the last few step sizes, since a host's steps differ by roundings at most. */
typedef struct {
    double h;
    double e_re[MODES], e_im[MODES]; /* e^(lambda h) */
    double first_re[MODES], first_im[MODES]; /* h (phi1 - phi2) */
    double second_re[MODES], second_im[MODES]; /* h phi2 */
} Factors;

/* Real parts of all modes, then imaginary parts of the pairs; room to the end of the last block. */
typedef struct {
    double at[STATE_BLOCKS * BLOCK];
} Modal;

/* The last b u, too: most steps begin with the inputs that the last one ended with. */
typedef struct {
    Factors kept[KEPT];
    size_t newest;
    double input[INPUTS];
    Modal load;
} Work;

/* Memory.state: z; the inputs that the outputs belong to, with friction in them; 1 for each block of outputs that is
 * computed. A block is left until one of its outputs is asked for. */
enum { REACHED = STATE_COUNT, COMPUTED = REACHED + INPUTS };

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

static const Factors *factors(Work *work, double h)
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

/* Eight rows of y = matrix x. A matrix is stored in blocks of eight rows, so that a compiler keeps eight sums in registers
 * and adds in the same order everywhere. */
static void multiply_block(const double *block, int columns, const double *x, double *y)
{
    double sum[BLOCK] = {0.0};
    for (int c = 0; c < columns; c++, block += BLOCK) {
        for (int r = 0; r < BLOCK; r++) {
            sum[r] += block[r] * x[c];
        }
    }
    memcpy(y, sum, sizeof sum);
}

static void multiply(const double *matrix, int blocks, int columns, const double *x, double *y)
{
    for (int b = 0; b < blocks; b++) {
        multiply_block(matrix + b * columns * BLOCK, columns, x, y + b * BLOCK);
    }
}

/* b u. */
static void load(const double *u, Modal *w)
{
    multiply(B, STATE_BLOCKS, INPUTS, u, w->at);
}

/* b u, which is kept. */
static void load_once(Work *work, const double *u, Modal *w)
{
    if (memcmp(work->input, u, sizeof work->input) != 0) { /* all zero is right from the beginning */
        memcpy(work->input, u, sizeof work->input);
        load(u, &work->load);
    }
    *w = work->load;
}

/* z(h) from z, b u0 and b u1. */
static void advance(const Factors *restrict f, const Modal *restrict z, const Modal *restrict w0,
                    const Modal *restrict w1, Modal *restrict end)
{
    const double *x = z->at, *y = z->at + MODE_COUNT, *a = w0->at, *b = w0->at + MODE_COUNT, *c = w1->at,
                 *d = w1->at + MODE_COUNT;
    for (int k = 0; k < PAIR_COUNT; k++) {
        end->at[k] = (f->e_re[k] * x[k] - f->e_im[k] * y[k]) + (f->first_re[k] * a[k] - f->first_im[k] * b[k]) +
                     (f->second_re[k] * c[k] - f->second_im[k] * d[k]);
    }
    for (int k = 0; k < PAIR_COUNT; k++) {
        end->at[MODE_COUNT + k] = (f->e_re[k] * y[k] + f->e_im[k] * x[k]) +
                                  (f->first_re[k] * b[k] + f->first_im[k] * a[k]) +
                                  (f->second_re[k] * d[k] + f->second_im[k] * c[k]);
    }
    for (int k = PAIR_COUNT; k < MODE_COUNT; k++) {
        end->at[k] = f->e_re[k] * x[k] + f->first_re[k] * a[k] + f->second_re[k] * c[k];
    }
}

static void recall_state(const Memory *memory, Modal *z)
{
    memcpy(z->at, memory->state, STATE_COUNT * sizeof *z->at);
}

static void keep_state(Memory *memory, const Modal *z, const double *u)
{
    memcpy(memory->state, z->at, STATE_COUNT * sizeof *z->at);
    memcpy(memory->state + REACHED, u, INPUTS * sizeof *u);
    memset(memory->state + COMPUTED, 0, OUTPUT_BLOCKS * sizeof *u);
}

/* ---- Friction at the ports ------------------------------------------------------------------------------------------ */

/* 1/s: the sum over the ports of the friction's slope at zero velocity times the port's mobility. */
static double friction_rate(const Parameters *p)
{
    double rate = 0.0;
    for (int i = 0; i < PORT_COUNT; i++) {
        rate += p->friction_force[i] / p->friction_velocity[i] * MOBILITY[i];
    }
    return rate;
}

static int has_friction(const Parameters *p)
{
    for (int i = 0; i < PORT_COUNT; i++) {
        if (p->friction_force[i] > 0.0) {
            return 1;
        }
    }
    return 0;
}

/* What friction adds to the inputs in state z. */
static void add_friction(const Parameters *p, const Modal *z, double *u)
{
    double v[PORT_BLOCKS * BLOCK];
    multiply(V, PORT_BLOCKS, STATE_COUNT, z->at, v);
    for (int i = 0; i < PORT_COUNT; i++) {
        u[PORT_INPUT[i]] += p->friction_force[i] * hyperbolic_tangent(v[i] / p->friction_velocity[i]);
    }
}

static int whole_number_above(double count)
{
    const int whole = (int)count;
    return whole < 1 ? 1 : whole + ((double)whole < count);
}

static void interpolate(const double *from, const double *to, double share, double *u)
{
    for (int i = 0; i < INPUTS; i++) {
        u[i] = from[i] + (to[i] - from[i]) * share;
    }
}

/* One sub-step with friction; u0 and u1 are the inputs at its ends. */
static void rub(const Parameters *p, const Factors *f, const double *u0, const double *u1, Modal *z)
{
    double start[INPUTS], end[INPUTS];
    Modal w0, w1, predicted, corrected;
    memcpy(start, u0, sizeof start);
    memcpy(end, u1, sizeof end);
    add_friction(p, z, start);
    add_friction(p, z, end);
    load(start, &w0);
    load(end, &w1);
    advance(f, z, &w0, &w1, &predicted);
    memcpy(end, u1, sizeof end);
    add_friction(p, &predicted, end);
    load(end, &w1);
    advance(f, z, &w0, &w1, &corrected);
    *z = corrected;
}

static void step_with_friction(const Parameters *p, Work *work, const double *from, const double *to, double h, int count,
                               Modal *z)
{
    const Factors *f = factors(work, h / (double)count);
    double u0[INPUTS], u1[INPUTS];
    memcpy(u0, from, sizeof u0);
    for (int k = 1; k <= count; k++) {
        interpolate(from, to, k == count ? 1.0 : (double)k / (double)count, u1);
        rub(p, f, u0, u1, z);
        memcpy(u0, u1, sizeof u0);
    }
}

static void step_without_friction(Work *work, const double *from, const double *to, double h, Modal *z)
{
    Modal w0, w1, end;
    load_once(work, from, &w0);
    load_once(work, to, &w1);
    advance(factors(work, h), z, &w0, &w1, &end);
    *z = end;
}

/* ---- Outputs -------------------------------------------------------------------------------------------------------- */

/* Eight outputs: y = C z + D u + static state. */
static void respond(Memory *memory, int block)
{
    double y[BLOCK];
    const double *z = memory->state, *u = memory->state + REACHED;
    const Parameters *p = &memory->values.named.parameters;
    const int first = block * BLOCK, count = OUTPUTS - first < BLOCK ? OUTPUTS - first : BLOCK;
    multiply_block(C + first * STATE_COUNT, STATE_COUNT, z, y);
    for (int k = DIRECT_BEGIN[block]; k < DIRECT_BEGIN[block + 1]; k++) {
        y[DIRECT_OUTPUT[k] - first] += DIRECT_TERM[k] * u[DIRECT_INPUT[k]];
    }
    for (int k = OFFSET_BEGIN[block]; k < OFFSET_BEGIN[block + 1]; k++) {
        y[OFFSET_OUTPUT[k] - first] += p->offset[OFFSET_PLACE[k]];
    }
    memcpy(memory->values.named.signals.output + first, y, (size_t)count * sizeof *y);
}

void model_output(Memory *memory, int output)
{
    const int block = output / BLOCK;
    if (memory->state[COMPUTED + block] == 0.0) {
        respond(memory, block);
        memory->state[COMPUTED + block] = 1.0;
    }
}

/* Far from where an output or the next step could overflow. */
static int is_sound(const Modal *z)
{
    int sound = 1;
    for (int k = 0; k < STATE_COUNT; k++) {
        sound &= z->at[k] > -LARGEST && z->at[k] < LARGEST;
    }
    return sound;
}

/* Keeps state z, and the inputs there. */
static void reach(Memory *memory, const Modal *z)
{
    double u[INPUTS];
    const Parameters *p = &memory->values.named.parameters;
    memcpy(u, memory->values.named.signals.input, sizeof u);
    if (has_friction(p)) {
        add_friction(p, z, u);
    }
    keep_state(memory, z, u);
}

/* ---- What component.h asks of a model ------------------------------------------------------------------------------- */

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

/* The steady state z = -b u / lambda; at rest the ports do not move, so that friction has no part in it. */
static void settle(const double *u, Modal *z)
{
    Modal w;
    load(u, &w);
    for (int k = 0; k < PAIR_COUNT; k++) {
        const double square = SIGMA[k] * SIGMA[k] + OMEGA[k] * OMEGA[k], re = w.at[k], im = w.at[MODE_COUNT + k];
        z->at[k] = -(re * SIGMA[k] + im * OMEGA[k]) / square;
        z->at[MODE_COUNT + k] = -(im * SIGMA[k] - re * OMEGA[k]) / square;
    }
    for (int k = PAIR_COUNT; k < MODE_COUNT; k++) {
        z->at[k] = -w.at[k] / SIGMA[k];
    }
}

int model_start(Memory *memory, void *work, Message *why)
{
    Modal z;
    (void)work;
    memset(&z, 0, sizeof z);
    if (memory->flag[start_at_equilibrium] && !HAS_EQUILIBRIUM) {
        say(why, "this vehicle has no unique steady state (a part of it is free to drift): set start_at_equilibrium to "
                 "false");
        return 0;
    }
    if (memory->flag[start_at_equilibrium]) {
        settle(memory->values.named.signals.input, &z);
    }
    reach(memory, &z);
    for (int output = 0; output < OUTPUTS; output += BLOCK) {
        model_output(memory, output);
    }
    return 1;
}

int model_step(Memory *memory, const double *from, double h, void *work, Message *why)
{
    Modal z;
    const Signals *s = &memory->values.named.signals;
    const Parameters *p = &memory->values.named.parameters;
    const double count = has_friction(p) ? h * friction_rate(p) / SUB_STEP_SHARE : 0.0;
    if (!(count <= MOST_SUB_STEPS)) {
        say(why, "the friction is too stiff for so long a step: take a smaller step, less friction_force or a larger "
                 "friction_velocity");
        return 0;
    }
    recall_state(memory, &z);
    if (count > 0.0) {
        step_with_friction(p, (Work *)work, from, s->input, h, whole_number_above(count), &z);
    } else {
        step_without_friction((Work *)work, from, s->input, h, &z);
    }
    reach(memory, &z);
    return is_sound(&z);
}

double model_direct_term(const Memory *memory, int output, int input)
{
    (void)memory;
    for (int k = 0; k < DIRECT_COUNT; k++) {
        if (DIRECT_OUTPUT[k] + INPUTS == output && DIRECT_INPUT[k] == input) {
            return DIRECT_TERM[k];
        }
    }
    return 0.0;
}
