/* vehicle_ss: x' = A x + B u, y = C x + D u, in real block-modal form: each mode is an independent equation z' = lambda z + b u,
 * with a complex z for a pair of eigenvalues and a real one for a real eigenvalue; y depends on the parts of all z, and on u. Modes that
 * are nearly dependent are replaced by real states that remain coupled (coupled.h), with matrices in place of the factors below.
 *
 * For inputs that change linearly from u0 to u1 over a step h the solution is exact at any h:
 *     z(h) = e^(lambda h) z + h (phi1 - phi2) b u0 + h phi2 b u1
 *     phi1(x) = (e^x - 1) / x,   phi2(x) = (phi1(x) - 1) / x
 * The forces of friction and springs at the ports (port_forces.h) are added to the shock forces. They are interpolated linearly over
 * each sub-step, from their values at the start to their values at the predicted end (second order; eightpost/vehicle/friction.py). */
#include <string.h>

#include "advance.h"
#include "component.h"
#include "elementary.h"
#include "factors.h"
#include "fresh.h"
#include "modal.h"
#include "port_forces.h"
#include "steady_state.h"
#include "sub_steps.h"
#include "vehicle_data.h"

enum { KEPT = 4 };

/* The factors are kept for the last few step sizes, because a host's steps differ only by rounding; and so are the last two b u:
 * most steps begin with the inputs with which the last one ended. */
typedef struct {
    Factors kept[KEPT];
    size_t newest;
    double input[INPUTS]; /* inputs of load[loaded] */
    size_t loaded;
    Modal load[2];
} Work;

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

/* ---- A step with friction and springs at the ports ------------------------------------------------------------------ */

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
