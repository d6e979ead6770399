/* Lower limit of the cost: the coupled car in a plain C loop over the same FMUs, with nothing around it.
 *
 *     master <car library> <car guid> <shock library> <shock guid> <job file> <result file>
 *
 * The job file, all doubles: scheme (HELD, ...), steps, step [s], stop [s], the references of the car's 7 driven
 * inputs, 4 forces, 4 velocities, 4 displacements and 10 outputs, of a shock's velocity, displacement and force, and
 * the drive at every coupling point, a row of 7 each. The result file: the processor time of the steps [s], and a row of
 * 14 recorded values per coupling point. Schemes are those of fmpy_loop.py, in the same order of operations. */
#define _POSIX_C_SOURCE 199309L
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi2Functions.h"

enum { CORNERS = 4, DRIVEN = 7, OUTPUTS = 10, CAR_INPUTS = DRIVEN + CORNERS, STATE = 2 * CORNERS + OUTPUTS };
enum { RECORDED = OUTPUTS + CORNERS, REFERENCES = CAR_INPUTS + STATE + 3, REFUSED = 3 };
enum { JACOBI_HELD, JACOBI_EXTRAPOLATED, GAUSS_SEIDEL_EXTRAPOLATED, GAUSS_SEIDEL_PARABOLIC };

typedef struct {
    fmi2SetRealTYPE *set;
    fmi2SetRealInputDerivativesTYPE *slope;
    fmi2DoStepTYPE *step;
    fmi2GetRealTYPE *get;
    fmi2Component instance;
} Unit;

/* A coupled signal at the ends of the last steps, and at the end of this one if it is known. */
typedef struct {
    double now, past, older, ahead;
} Signal;

typedef struct {
    double start, slope;
} Line;

static const fmi2Integer FIRST[CAR_INPUTS] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1};

static void stop(const char *what, int code)
{
    fprintf(stderr, "master: %s\n", what);
    exit(code);
}

static void check(int status)
{
    if (status > fmi2Warning) {
        stop("an FMU refused a call", REFUSED);
    }
}

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    (void)environment, (void)name, (void)status, (void)category, (void)message;
}

static void *symbol(void *library, const char *name)
{
    void *found = dlsym(library, name);
    if (found == NULL) {
        stop(name, 1);
    }
    return found;
}

#define BIND(target, library, name) (*(void **)&(target) = symbol(library, name))

static Unit begin(void *library, const char *guid, const char *name, double until)
{
    static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
    fmi2InstantiateTYPE *instantiate;
    fmi2SetupExperimentTYPE *set_up;
    fmi2EnterInitializationModeTYPE *enter;
    Unit unit;
    BIND(instantiate, library, "fmi2Instantiate");
    BIND(set_up, library, "fmi2SetupExperiment");
    BIND(enter, library, "fmi2EnterInitializationMode");
    BIND(unit.set, library, "fmi2SetReal");
    BIND(unit.slope, library, "fmi2SetRealInputDerivatives");
    BIND(unit.step, library, "fmi2DoStep");
    BIND(unit.get, library, "fmi2GetReal");
    unit.instance = instantiate(name, fmi2CoSimulation, guid, "file:///", &callbacks, fmi2False, fmi2False);
    if (unit.instance == NULL) {
        stop("an FMU cannot be instantiated", 1);
    }
    check(set_up(unit.instance, fmi2False, 0.0, 0.0, fmi2True, until));
    check(enter(unit.instance));
    return unit;
}

static void leave_initialization(void *library, Unit unit)
{
    fmi2ExitInitializationModeTYPE *leave;
    BIND(leave, library, "fmi2ExitInitializationMode");
    check(leave(unit.instance));
}

static double *doubles(const char *path, size_t *count)
{
    FILE *file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0) {
        stop(path, 1);
    }
    *count = (size_t)ftell(file) / sizeof(double);
    rewind(file);
    double *values = malloc(*count * sizeof(double));
    if (values == NULL || fread(values, sizeof(double), *count, file) != *count) {
        stop(path, 1);
    }
    fclose(file);
    return values;
}

static double processor_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* A straight line with the mean of a parabola through the last step's start, and the line's end (sweep.py). */
static Line parabolic(const Signal *s, double end, double h)
{
    const double start = s->now - (end - s->now - (s->now - s->past)) / 6.0;
    return (Line){start, (end - start) / h};
}

static Line supposed(const Signal *s, int scheme, double h)
{
    if (scheme == JACOBI_HELD) {
        return (Line){s->now, 0.0};
    }
    if (scheme == GAUSS_SEIDEL_PARABOLIC) {
        return parabolic(s, s->now + 2.0 * (s->now - s->past) - (s->past - s->older), h);
    }
    return (Line){s->now, (s->now - s->past) / h};
}

static Line known(const Signal *s, int scheme, double h)
{
    return scheme == GAUSS_SEIDEL_PARABOLIC ? parabolic(s, s->ahead, h) : (Line){s->now, (s->ahead - s->now) / h};
}

static void advance(Unit unit, const fmi2ValueReference *inputs, const Line *lines, size_t count, int scheme,
                    double time, double h)
{
    double values[CAR_INPUTS], slopes[CAR_INPUTS];
    for (size_t k = 0; k < count; k++) {
        values[k] = lines[k].start;
        slopes[k] = lines[k].slope;
    }
    check(unit.set(unit.instance, inputs, count, values));
    if (scheme != JACOBI_HELD) {
        check(unit.slope(unit.instance, inputs, count, FIRST, slopes));
    }
    check(unit.step(unit.instance, time, h, fmi2True));
}

typedef struct {
    Unit car, shocks[CORNERS];
    fmi2ValueReference inputs[CAR_INPUTS], state[STATE], port[2], force;
    Signal velocity[CORNERS], displacement[CORNERS], push[CORNERS];
    double outputs[OUTPUTS];
    int scheme;
} System;

static void read_car(System *s)
{
    double state[STATE];
    check(s->car.get(s->car.instance, s->state, STATE, state));
    for (int k = 0; k < CORNERS; k++) {
        s->velocity[k].ahead = state[k];
        s->displacement[k].ahead = state[CORNERS + k];
    }
    memcpy(s->outputs, state + 2 * CORNERS, sizeof s->outputs);
}

static void read_shocks(System *s)
{
    for (int k = 0; k < CORNERS; k++) {
        check(s->shocks[k].get(s->shocks[k].instance, &s->force, 1, &s->push[k].ahead));
    }
}

static void shift(Signal *signals)
{
    for (int k = 0; k < CORNERS; k++) {
        signals[k].older = signals[k].past;
        signals[k].past = signals[k].now;
        signals[k].now = signals[k].ahead;
    }
}

static void accept(System *s)
{
    shift(s->velocity);
    shift(s->displacement);
    shift(s->push);
}

static void write_row(const System *s, double *row)
{
    memcpy(row, s->outputs, sizeof s->outputs);
    for (int k = 0; k < CORNERS; k++) {
        row[OUTPUTS + k] = s->push[k].now;
    }
}

/* The equilibrium start: values are passed between the FMUs in initialization mode. */
static void settle(System *s, const double *drive)
{
    read_car(s);
    read_shocks(s);
    for (int sweep = 0; sweep < 10; sweep++) {
        double inputs[CAR_INPUTS];
        memcpy(inputs, drive, DRIVEN * sizeof(double));
        for (int k = 0; k < CORNERS; k++) {
            const double port[2] = {s->velocity[k].ahead, s->displacement[k].ahead};
            inputs[DRIVEN + k] = s->push[k].ahead;
            check(s->shocks[k].set(s->shocks[k].instance, s->port, 2, port));
        }
        check(s->car.set(s->car.instance, s->inputs, CAR_INPUTS, inputs));
        read_car(s);
        read_shocks(s);
    }
}

static void step_car(System *s, const double *row, double time, double h)
{
    Line lines[CAR_INPUTS];
    for (int d = 0; d < DRIVEN; d++) {
        lines[d] = (Line){row[d], s->scheme == JACOBI_HELD ? 0.0 : (row[d + DRIVEN] - row[d]) / h};
    }
    for (int k = 0; k < CORNERS; k++) {
        lines[DRIVEN + k] = supposed(&s->push[k], s->scheme, h);
    }
    advance(s->car, s->inputs, lines, CAR_INPUTS, s->scheme, time, h);
}

static void step_shocks(System *s, Line (*rule)(const Signal *, int, double), double time, double h)
{
    for (int k = 0; k < CORNERS; k++) {
        const Line lines[2] = {rule(&s->velocity[k], s->scheme, h), rule(&s->displacement[k], s->scheme, h)};
        advance(s->shocks[k], s->port, lines, 2, s->scheme, time, h);
    }
}

static void one_step(System *s, const double *row, double time, double h)
{
    step_car(s, row, time, h);
    if (s->scheme >= GAUSS_SEIDEL_EXTRAPOLATED) {
        read_car(s);
        step_shocks(s, known, time, h);
    } else {
        step_shocks(s, supposed, time, h);
        read_car(s);
    }
    read_shocks(s);
    accept(s);
}

static void take_references(System *s, const double *given)
{
    fmi2ValueReference all[REFERENCES];
    for (int k = 0; k < REFERENCES; k++) {
        all[k] = (fmi2ValueReference)given[k];
    }
    memcpy(s->inputs, all, sizeof s->inputs);
    memcpy(s->state, all + CAR_INPUTS, sizeof s->state);
    memcpy(s->port, all + CAR_INPUTS + STATE, sizeof s->port);
    s->force = all[REFERENCES - 1];
}

int main(int count, char *words[])
{
    if (count != 7) {
        stop("six arguments are required", 1);
    }
    size_t size;
    double *job = doubles(words[5], &size);
    const long steps = (long)job[1];
    const double h = job[2], *drive = job + 4 + REFERENCES;
    void *car = dlopen(words[1], RTLD_NOW | RTLD_LOCAL), *shock = dlopen(words[3], RTLD_NOW | RTLD_LOCAL);
    double *rows = malloc((size_t)(steps + 1) * RECORDED * sizeof(double));
    if (car == NULL || shock == NULL || rows == NULL || size != 4 + REFERENCES + (size_t)(steps + 1) * DRIVEN) {
        stop("a library cannot be loaded, or the job file is incomplete", 1);
    }
    System s = {.scheme = (int)job[0]};
    take_references(&s, job + 4);
    s.car = begin(car, words[2], "car", job[3]);
    for (int k = 0; k < CORNERS; k++) {
        s.shocks[k] = begin(shock, words[4], "shock", job[3]);
    }
    settle(&s, drive);
    leave_initialization(car, s.car);
    for (int k = 0; k < CORNERS; k++) {
        leave_initialization(shock, s.shocks[k]);
    }
    read_car(&s);
    read_shocks(&s);
    for (int k = 0; k < 3; k++) {
        accept(&s);
    }
    write_row(&s, rows);
    const double began = processor_seconds();
    for (long k = 0; k < steps; k++) {
        one_step(&s, drive + k * DRIVEN, (double)k * h, h);
        write_row(&s, rows + (k + 1) * RECORDED);
    }
    const double seconds = processor_seconds() - began;
    FILE *file = fopen(words[6], "wb");
    if (file == NULL || fwrite(&seconds, sizeof seconds, 1, file) != 1 ||
        fwrite(rows, RECORDED * sizeof(double), (size_t)(steps + 1), file) != (size_t)(steps + 1) || fclose(file)) {
        stop(words[6], 1);
    }
    return 0;
}
