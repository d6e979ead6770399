/* assembly: a vehicle and its shocks with the coupling solved inside. A communication step is cut into equal micro steps of
 * at most coupling_step. In each the vehicle steps first, with the shock forces extrapolated by the slope of their last
 * micro step; then each shock, with the vehicle's outputs going linearly from the start to the end of the micro step. It is
 * the scheme of `eightpost run` (gauss-seidel, extrapolated values), operation by operation. */
#include <string.h>

#include "assembly_data.h"
#include "component.h"
#include "elementary.h"
#include "part.h"

static const double MOST_MICRO_STEPS = 1e7;

/* This much of a micro step is rounding of the communication step. */
static const double ROUNDING = 1e-9;

/* An extrapolated value that goes linearly to the end of a step misses this share of its defect there, in the mean over the
 * step: a parabola through both ends of the last step and the end of this one (docs/coupling.md). */
static const double MEAN_DEFECT = 5.0 / 12.0;

/* Of a force that has moved by less than this, of its mean and of 1 N, no share is told: it would be one of roundings. */
static const double LEAST_SPREAD = 1e-4;

/* A coupled start agrees to this share of each force; one with springs alone takes a Newton step, and one for rounding. */
static const double AGREEMENT = 1e-13;
enum { MOST_NEWTON_STEPS = 20 };

/* Memory.state: what each part keeps (PARTS_KEEP numbers), then the coupled signals and their slopes, then the meters of
 * the forces, and the time that they have run. */
enum {
    NOW = PARTS_KEEP,
    SLOPE = NOW + COUPLED,
    DEFECT = SLOPE + COUPLED,
    MEAN = DEFECT + FORCES,
    SPREAD = MEAN + FORCES,
    DURATION = SPREAD + FORCES
};

/* ---- The parts by their kind ---------------------------------------------------------------------------------------- */

#define NAMED(kind, function) fmi2FullName(kind##_##function)
#define DECLARE(kind) PART_FUNCTIONS(NAMED, kind)
PART_KINDS(DECLARE)

#define CASE_SIZE(kind) case KIND_##kind: return NAMED(kind, part_size)();
#define CASE_LOAD(kind) case KIND_##kind: NAMED(kind, part_load)(part, kept); break;
#define CASE_STORE(kind) case KIND_##kind: NAMED(kind, part_store)(part, moving); break;
#define CASE_VALUES(kind) case KIND_##kind: return NAMED(kind, part_values)(part);
#define CASE_REFUSES(kind) case KIND_##kind: return NAMED(kind, part_refuses)(parameters, why);
#define CASE_WARNS(kind) case KIND_##kind: return NAMED(kind, part_warns)(parameters, why);
#define CASE_START(kind) case KIND_##kind: return NAMED(kind, part_start)(part, why);
#define CASE_STEP(kind) case KIND_##kind: return NAMED(kind, part_step)(part, from, h, why);
#define CASE_OUTPUT(kind) case KIND_##kind: NAMED(kind, part_output)(part, output); break;
#define CASE_DIRECT(kind) case KIND_##kind: return NAMED(kind, part_direct_term)(kept, output, input);

static size_t size_of_part(int kind)
{
    switch (kind) { PART_KINDS(CASE_SIZE) default: return 0; }
}

static void load(int kind, void *part, const Kept *kept)
{
    switch (kind) { PART_KINDS(CASE_LOAD) default: break; }
}

static void store(int kind, const void *part, double *moving)
{
    switch (kind) { PART_KINDS(CASE_STORE) default: break; }
}

static double *values_of(int kind, void *part)
{
    switch (kind) { PART_KINDS(CASE_VALUES) default: return NULL; }
}

static int refuses(int kind, const double *parameters, Message *why)
{
    switch (kind) { PART_KINDS(CASE_REFUSES) default: return 0; }
}

static int warns(int kind, const double *parameters, Message *why)
{
    switch (kind) { PART_KINDS(CASE_WARNS) default: return 0; }
}

static int start(int kind, void *part, Message *why)
{
    switch (kind) { PART_KINDS(CASE_START) default: return 0; }
}

static int step(int kind, void *part, const double *from, double h, Message *why)
{
    switch (kind) { PART_KINDS(CASE_STEP) default: return 0; }
}

static void compute_output(int kind, void *part, int output)
{
    switch (kind) { PART_KINDS(CASE_OUTPUT) default: break; }
}

static double direct_term(int kind, const Kept *kept, int output, int input)
{
    switch (kind) { PART_KINDS(CASE_DIRECT) default: return 0.0; }
}

/* ---- All parts of an instance --------------------------------------------------------------------------------------- */

/* The parts while they are started or stepped: where each is in the work space, and the coupled signals. */
typedef struct {
    void *part[PARTS];
    double *values[PARTS];
    double now[COUPLED]; /* at the start of the micro step */
    double slope[COUPLED]; /* 1/s, over the last one */
    double ahead[COUPLED]; /* at its end, of parts that have stepped */
} Machine;

static Kept kept_of(const Memory *memory, int p)
{
    const Kept kept = {
        memory->state + PART[p].kept,
        memory->values.named.parameters.parameter + PART[p].parameters,
        memory->flag + PART[p].flags,
        (size_t)PART[p].flag_count,
        memory->stale,
    };
    return kept;
}

static void unpack(Machine *m, const Memory *memory, void *work)
{
    unsigned char *place = (unsigned char *)work;
    for (int p = 0; p < PARTS; p++) {
        const Kept kept = kept_of(memory, p);
        m->part[p] = place;
        load(PART[p].kind, place, &kept);
        m->values[p] = values_of(PART[p].kind, place);
        place += size_of_part(PART[p].kind);
    }
    memcpy(m->now, memory->state + NOW, sizeof m->now);
    memcpy(m->slope, memory->state + SLOPE, sizeof m->slope);
}

static void compute_outputs(const Machine *m)
{
    for (int p = 0; p < PARTS; p++) {
        for (int output = 0; output < PART[p].output_count; output++) {
            compute_output(PART[p].kind, m->part[p], output);
        }
    }
}

/* Keeps the parts, and gives their outputs and local variables. */
static void pack(const Machine *m, Memory *memory)
{
    double *at = memory->values.at;
    compute_outputs(m);
    for (int p = 0; p < PARTS; p++) {
        const double *outputs = m->values[p] + PART[p].input_count;
        const double *locals = outputs + PART[p].output_count;
        store(PART[p].kind, m->part[p], memory->state + PART[p].kept);
        memcpy(at + PART[p].outputs, outputs, (size_t)PART[p].output_count * sizeof *at);
        memcpy(at + PART[p].locals, locals, (size_t)PART[p].local_count * sizeof *at);
    }
    memcpy(memory->state + NOW, m->now, sizeof m->now);
    memcpy(memory->state + SLOPE, m->slope, sizeof m->slope);
}

static void told_by(int p, const Message *said, Message *why)
{
    say(why, PART[p].name);
    say(why, ": ");
    say(why, said->length > 0 ? said->text : "the result is not finite");
}

/* ---- A micro step --------------------------------------------------------------------------------------------------- */

static double through(const Term *t, double value)
{
    return t->gain * (t->factor * value + t->offset);
}

/* Brings the coupled outputs of part p to where the part is. */
static void read_part(Machine *m, int p)
{
    for (int s = PART[p].signals; s < PART[p].signals + PART[p].signal_count; s++) {
        compute_output(PART[p].kind, m->part[p], SIGNAL[s].output);
        m->ahead[s] = m->values[p][PART[p].input_count + SIGNAL[s].output];
    }
}

/* The inputs of part p at both ends of a micro step of h [s]; the vehicle's outputs are known at its end, forces go on with
 * their slope. */
static void feed(const Machine *m, int p, const double *outside0, const double *outside1, double h, double *from,
                 double *to)
{
    for (int i = 0; i < PART[p].input_count; i++) {
        const Feed *fed = &FEED[PART[p].feeds + i];
        double begin = 0.0, end = 0.0;
        for (int k = fed->first; k < fed->last; k++) {
            const int s = TERM[k].signal;
            begin += through(&TERM[k], m->now[s]);
            end += through(&TERM[k], SIGNAL[s].part == 0 ? m->ahead[s] : m->now[s] + m->slope[s] * h);
        }
        if (fed->outside >= 0) {
            begin += outside0[fed->outside];
            end += outside1[fed->outside];
        }
        from[i] = begin;
        to[i] = begin + (end - begin) / h * h; /* as a host's input derivative gives it */
    }
}

static int step_part(Machine *m, int p, const double *outside0, const double *outside1, double h, Message *why)
{
    double from[MOST_INPUTS];
    Message said;
    said.length = 0; /* of its text there is none yet */
    feed(m, p, outside0, outside1, h, from, m->values[p]);
    if (!step(PART[p].kind, m->part[p], from, h, &said)) {
        told_by(p, &said, why);
        return 0;
    }
    read_part(m, p);
    return 1;
}

/* Adds the squares of what each force was taken for at the end of the micro step less what came; and its mean, and its
 * squares about that, with no difference of large numbers (West, Comm. ACM 22 (1979) 532-535). */
static void add_defects(const Machine *m, double *state, double h)
{
    state[DURATION] += h;
    for (int s = 0; s < FORCES; s++) {
        const double missed = m->now[s] + m->slope[s] * h - m->ahead[s], apart = m->ahead[s] - state[MEAN + s];
        state[DEFECT + s] += missed * missed * h;
        state[MEAN + s] += apart * (h / state[DURATION]);
        state[SPREAD + s] += h * apart * (m->ahead[s] - state[MEAN + s]);
    }
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

/* How many micro steps of at most `most` [s] make up h [s]; 0: too many. */
static int micro_steps(double h, double most)
{
    const double count = h / most;
    if (!(count <= MOST_MICRO_STEPS)) {
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

static int step_all(Machine *m, Memory *memory, const double *from, double h, int count, Message *why)
{
    const double *to = memory->values.named.signals.input;
    double outside0[INPUTS], outside1[INPUTS];
    memcpy(outside0, from, sizeof outside0);
    for (int k = 1; k <= count; k++) {
        interpolate(from, to, (double)k / (double)count, outside1);
        if (!micro_step(m, memory->state, outside0, k == count ? to : outside1, h / (double)count, why)) {
            return 0;
        }
        memcpy(outside0, outside1, sizeof outside0);
    }
    return 1;
}

/* ---- The coupled start: forces that the shocks give at what the vehicle does under them --------------------------------- */

/* Starts every part, the vehicle under the forces `taken`; `missed` is what the shocks then give, less that. */
static int start_all(Machine *m, const double *outside, const double *taken, double *missed, Message *why)
{
    double from[MOST_INPUTS];
    memcpy(m->now, taken, FORCES * sizeof *taken);
    for (int p = 0; p < PARTS; p++) {
        Message said = {.length = 0};
        feed(m, p, outside, outside, 1.0, from, m->values[p]);
        memcpy(m->values[p], from, (size_t)PART[p].input_count * sizeof *from);
        if (!start(PART[p].kind, m->part[p], &said)) {
            told_by(p, &said, why);
            return 0;
        }
        read_part(m, p);
        for (int s = FORCES; s < COUPLED && p == 0; s++) {
            m->now[s] = m->ahead[s];
        }
    }
    for (int s = 0; s < FORCES; s++) {
        missed[s] = m->ahead[s] - taken[s];
    }
    return 1;
}

static double size_of(double value)
{
    return value < 0.0 ? -value : value;
}

static int agrees(const double *taken, const double *missed)
{
    for (int s = 0; s < FORCES; s++) {
        if (!(size_of(missed[s]) <= AGREEMENT * (size_of(taken[s]) + 1.0))) {
            return 0;
        }
    }
    return 1;
}

/* A row of FORCES + 1 numbers for each force: a system of linear equations with its right side. */
typedef struct {
    double row[FORCES][FORCES + 1];
} Equations;

/* By elimination with row exchange; 0 if there is no unique solution. */
static int solved(Equations *e, double *x)
{
    for (int k = 0; k < FORCES; k++) {
        int pivot = k;
        for (int r = k + 1; r < FORCES; r++) {
            pivot = size_of(e->row[r][k]) > size_of(e->row[pivot][k]) ? r : pivot;
        }
        if (!(size_of(e->row[pivot][k]) > 1e-12)) {
            return 0;
        }
        for (int c = 0; c <= FORCES; c++) {
            const double exchanged = e->row[k][c];
            e->row[k][c] = e->row[pivot][c];
            e->row[pivot][c] = exchanged;
        }
        for (int r = k + 1; r < FORCES; r++) {
            const double share = e->row[r][k] / e->row[k][k];
            for (int c = k; c <= FORCES; c++) {
                e->row[r][c] -= share * e->row[k][c];
            }
        }
    }
    for (int k = FORCES - 1; k >= 0; k--) {
        x[k] = e->row[k][FORCES];
        for (int c = k + 1; c < FORCES; c++) {
            x[k] -= e->row[k][c] * x[c];
        }
        x[k] /= e->row[k][k];
    }
    return 1;
}

/* One Newton step; the derivatives are differences, which are exact for the straight lines of gas springs. */
static int improve(Machine *m, const double *outside, double *taken, const double *missed, Message *why)
{
    Equations e;
    double other[FORCES], then[FORCES];
    for (int c = 0; c < FORCES; c++) {
        memcpy(other, taken, sizeof other);
        other[c] += 1e-3 * size_of(taken[c]) + 1.0;
        if (!start_all(m, outside, other, then, why)) {
            return 0;
        }
        for (int r = 0; r < FORCES; r++) {
            e.row[r][c] = (missed[r] - then[r]) / (other[c] - taken[c]);
        }
    }
    for (int r = 0; r < FORCES; r++) {
        e.row[r][FORCES] = missed[r];
    }
    if (!solved(&e, other)) {
        say(why, "the vehicle and the springs of its shocks have no unique equilibrium: set start_at_equilibrium to false");
        return 0;
    }
    for (int s = 0; s < FORCES; s++) {
        taken[s] += other[s];
    }
    return 1;
}

static int settle(Machine *m, const double *outside, Message *why)
{
    double taken[FORCES] = {0.0}, missed[FORCES];
    for (int k = 0; k < MOST_NEWTON_STEPS; k++) {
        if (!start_all(m, outside, taken, missed, why)) {
            return 0;
        }
        if (agrees(taken, missed)) {
            return 1;
        }
        if (!improve(m, outside, taken, missed, why)) {
            return 0;
        }
    }
    say(why, "the vehicle and its shocks come to no coupled start: look at inputs, gas_stiffness and gas_preload");
    return 0;
}

/* ---- Error estimates ------------------------------------------------------------------------------------------------ */

/* Bit by bit the same on every platform, without the C library: Newton's iteration from half the exponent. */
static double square_root(double x)
{
    uint64_t bits;
    double root;
    if (!(x > DBL_MIN)) {
        return 0.0;
    }
    memcpy(&bits, &x, sizeof bits);
    bits = (bits >> 1) + (UINT64_C(1023) << 51);
    memcpy(&root, &bits, sizeof root);
    for (int k = 0; k < 5; k++) {
        root = 0.5 * (root + x / root);
    }
    return root;
}

/* N, root mean square since the start. */
static double local_error(const double *state, int s)
{
    return state[DURATION] > 0.0 ? MEAN_DEFECT * square_root(state[DEFECT + s] / state[DURATION]) : 0.0;
}

/* N, standard deviation since the start. */
static double spread(const double *state, int s)
{
    return state[DURATION] > 0.0 ? square_root(state[SPREAD + s] / state[DURATION]) : 0.0;
}

/* %, of the worst bond. */
static double worst_error(const double *state)
{
    double worst = 0.0;
    for (int s = 0; s < FORCES; s++) {
        const double size = spread(state, s), least = LEAST_SPREAD * (size_of(state[MEAN + s]) + 1.0);
        const double percent = size > least ? 100.0 * local_error(state, s) / size : 0.0;
        worst = percent > worst ? percent : worst;
    }
    return worst;
}

/* ---- What component.h asks of a model ------------------------------------------------------------------------------- */

size_t model_work_size(void)
{
    size_t size = 0;
    for (int p = 0; p < PARTS; p++) {
        size += size_of_part(PART[p].kind);
    }
    return size;
}

static int said_of_parts(const Values *v, int (*says)(int, const double *, Message *), Message *why)
{
    int found = 0;
    for (int p = 0; p < PARTS; p++) {
        Message said = {.length = 0};
        if (says(PART[p].kind, v->named.parameters.parameter + PART[p].parameters, &said)) {
            say(why, found ? "; " : "");
            told_by(p, &said, why);
            found = 1;
        }
    }
    return found;
}

int model_refuses(const Values *v, Message *why)
{
    return said_of_parts(v, refuses, why);
}

int model_warns(const Values *v, Message *why)
{
    return said_of_parts(v, warns, why);
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
    for (int output = 0; output < OUTPUTS; output++) {
        model_output(memory, output);
    }
    return 1;
}

int model_step(Memory *memory, const double *from, double h, void *work, Message *why)
{
    Machine m;
    const int count = micro_steps(h, memory->values.named.parameters.parameter[COUPLING_STEP]);
    if (count == 0) {
        say(why, "a step of ");
        say_number(why, h);
        say(why, " s would take more than ten million micro steps: take a smaller step, or a larger coupling_step");
        return 0;
    }
    unpack(&m, memory, work);
    if (!step_all(&m, memory, from, h, count, why)) {
        return 0;
    }
    pack(&m, memory);
    return 1;
}

/* A step computes the parts' outputs; the error estimates are left until they are asked for. */
void model_output(Memory *memory, int output)
{
    double *y = memory->values.named.signals.output;
    if (output == WORST_ERROR) {
        y[output] = worst_error(memory->state);
    }
    for (int s = 0; s < FORCES; s++) {
        if (output == FORCE_ERROR[s]) {
            y[output] = local_error(memory->state, s);
        }
    }
}

/* d output / d input of part p, of indices in the part, for an input of the assembly: what it is given itself, and what
 * the vehicle's outputs bring it. */
static double part_term(const Memory *memory, int p, int output, int outside)
{
    const Kept kept = kept_of(memory, p);
    double sum = 0.0;
    for (int i = 0; i < PART[p].input_count; i++) {
        const Feed *fed = &FEED[PART[p].feeds + i];
        double moved = fed->outside == outside ? 1.0 : 0.0;
        for (int k = fed->first; k < fed->last && p > 0; k++) {
            const Coupled *source = &SIGNAL[TERM[k].signal];
            const Kept vehicle = kept_of(memory, 0);
            for (int j = 0; j < PART[0].input_count; j++) {
                if (FEED[PART[0].feeds + j].outside == outside) {
                    moved += TERM[k].gain * TERM[k].factor *
                             direct_term(PART[0].kind, &vehicle, PART[0].input_count + source->output, j);
                }
            }
        }
        sum += moved == 0.0 ? 0.0 : moved * direct_term(PART[p].kind, &kept, output, i);
    }
    return sum;
}

double model_direct_term(const Memory *memory, int output, int input)
{
    for (int p = 0; p < PARTS; p++) {
        if (output >= PART[p].outputs && output < PART[p].outputs + PART[p].output_count) {
            return part_term(memory, p, PART[p].input_count + output - PART[p].outputs, input);
        }
    }
    return 0.0;
}
