/* assembly: a vehicle and its shocks with the coupling solved inside. A communication step is divided into equal micro steps of at
 * most coupling_step. In each the vehicle steps first, with the shock forces extrapolated at the slope of their last micro step;
 * then each shock, with the vehicle's outputs interpolated linearly from the start to the end of the micro step. This is the scheme
 * of `eightpost run` (gauss-seidel, extrapolated values). Outputs of the vehicle are those under the forces at the end. */
#include <string.h>

#include "machine.h"
#include "part_kinds.h"

static const double MOST_MICRO_STEPS = 1e7;

/* This share of a micro step is treated as rounding of the communication step. */
static const double ROUNDING = 1e-9;

/* ---- A micro step --------------------------------------------------------------------------------------------------- */

static int step_part(Machine *m, int p, const double *outside0, const double *outside1, double h, Message *why)
{
    double from[MOST_INPUTS];
    Message message;
    message.length = 0; /* the text itself need not be initialized */
    feed(m, p, outside0, outside1, h, from, m->values[p]);
    if (!step(PART[p].kind, m->part[p], from, h, &message)) {
        add_part_message(p, &message, why);
        return 0;
    }
    read_part(m, p);
    return 1;
}

static int micro_step(Machine *m, double *state, const double *outside0, const double *outside1, double h, Message *why)
{
    for (int p = 0; p < PARTS; p++) {
        if (!step_part(m, p, outside0, outside1, h, why)) {
            return 0;
        }
    }
    add_defects(m, state, h);
    for (int s = 0; s < COUPLED; s++) {
        m->slope[s] = (m->ahead[s] - m->now[s]) / h;
        m->now[s] = m->ahead[s];
    }
    return 1;
}

/* The number of micro steps of at most `most` [s] that make up h [s]; 0: too many. */
static int micro_steps(double h, double most)
{
    const double count = h / most;
    if (!(count >= 0.0 && count <= MOST_MICRO_STEPS)) {
        return 0;
    }
    const int whole = (int)count;
    return whole + (count - (double)whole > ROUNDING * count || whole == 0);
}

static void interpolate(const double *from, const double *to, double share, double *u)
{
    for (int i = 0; i < INPUTS; i++) {
        u[i] = from[i] + (to[i] - from[i]) * share;
    }
}

static int step_all(Machine *m, double *state, const double *from, const double *to, double h, int count, Message *why)
{
    double outside0[INPUTS], outside1[INPUTS];
    memcpy(outside0, from, sizeof outside0);
    for (int k = 1; k <= count; k++) {
        interpolate(from, to, (double)k / (double)count, outside1);
        if (!micro_step(m, state, outside0, k == count ? to : outside1, h / (double)count, why)) {
            return 0;
        }
        memcpy(outside0, outside1, sizeof outside0);
    }
    return 1;
}

/* ---- Functions declared in component.h ------------------------------------------------------------------------------ */

size_t model_work_size(void)
{
    size_t size = 0;
    for (int p = 0; p < PARTS; p++) {
        size += size_of_part(PART[p].kind);
    }
    return size;
}

static int message_of_parts(const Values *v, int (*judge)(int, const double *, Message *), Message *why)
{
    int found = 0;
    for (int p = 0; p < PARTS; p++) {
        Message message = {.length = 0};
        if (judge(PART[p].kind, v->named.parameters.parameter + PART[p].parameters, &message)) {
            say(why, found ? "; " : "");
            add_part_message(p, &message, why);
            found = 1;
        }
    }
    return found;
}

int model_refuses(const Values *v, Message *why)
{
    return message_of_parts(v, refuses, why);
}

int model_warns(const Values *v, Message *why)
{
    return message_of_parts(v, warns, why);
}

int model_start(Memory *memory, void *work, Message *why)
{
    Machine m;
    unpack(&m, memory, work);
    memset(m.slope, 0, sizeof m.slope);
    if (!settle(&m, memory->values.named.signals.input, why)) {
        return 0;
    }
    memcpy(m.now, m.ahead, sizeof m.now);
    memset(memory->state + DEFECT, 0, (STATES - DEFECT) * sizeof *memory->state);
    pack(&m, memory);
    return 1;
}

int model_step(Memory *memory, const double *from, double h, void *work, Message *why)
{
    Machine m;
    double state[STATES]; /* with the error estimators */
    const double *to = memory->values.named.signals.input;
    const int count = micro_steps(h, memory->values.named.parameters.parameter[COUPLING_STEP]);
    if (count == 0) {
        say(why, "a step of ");
        say_number(why, h);
        say(why, " s would take more than ten million micro steps: take a smaller step, or a larger coupling_step");
        return 0;
    }
    unpack(&m, memory, work);
    memcpy(state, memory->state, sizeof state);
    if (!step_all(&m, state, from, to, h, count, why) || !are_sound(&m, state) || !evaluate_part(&m, 0, to, why)) {
        return 0;
    }
    memcpy(memory->state, state, sizeof state);
    pack(&m, memory);
    return 1;
}

/* A step computes the parts' outputs; the error estimates are computed when they are read. */
double model_output(const Memory *memory, int output)
{
    if (output == WORST_ERROR) {
        return worst_error(memory->state);
    }
    for (int s = 0; s < FORCES; s++) {
        if (output == FORCE_ERROR[s]) {
            return local_error(memory->state, s);
        }
    }
    return memory->values.named.signals.output[output];
}
