/* Times an FMU's steps in a C loop: benchmarks/native.py compiles and runs it.
 *
 *     step <library> <guid> <steps> held|ramped|irregular <input>,... <amplitude>,... <output>,...
 *
 * A step is what a coupling master does: set the inputs (and their derivatives unless held), fmi2DoStep, get the outputs.
 * Prints the mean, the share of 1 in 1,000 that was slowest, and the worst [ns]; the latter two include the clock. */
#define _POSIX_C_SOURCE 199309L
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi2Functions.h"

enum { MOST = 64, KINDS = 3 };

typedef struct {
    fmi2SetRealTYPE *set;
    fmi2SetRealInputDerivativesTYPE *slope;
    fmi2DoStepTYPE *step;
    fmi2GetRealTYPE *get;
    fmi2Component instance;
    fmi2ValueReference inputs[MOST], outputs[MOST];
    double amplitudes[MOST];
    size_t input_count, output_count;
} Loop;

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    (void)environment;
    (void)category;
    fprintf(stderr, "%s [%d]: %s\n", name, (int)status, message);
}

static void stop(const char *what)
{
    fprintf(stderr, "step: %s\n", what);
    exit(1);
}

static void *symbol(void *library, const char *name)
{
    void *found = dlsym(library, name);
    if (found == NULL) {
        stop(name);
    }
    return found;
}

#define BIND(target, library, name) (*(void **)&(target) = symbol(library, name))

static size_t numbers(char *text, double *values)
{
    size_t count = 0;
    for (char *part = strtok(text, ","); part != NULL && count < MOST; part = strtok(NULL, ",")) {
        values[count++] = strtod(part, NULL);
    }
    return count;
}

static size_t references(char *text, fmi2ValueReference *values)
{
    double found[MOST];
    const size_t count = numbers(text, found);
    for (size_t k = 0; k < count; k++) {
        values[k] = (fmi2ValueReference)found[k];
    }
    return count;
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* A triangle of period 200 steps, between -1 and 1. */
static double wave(long k)
{
    const long phase = k % 200;
    return phase < 100 ? (double)phase / 50.0 - 1.0 : 3.0 - (double)phase / 50.0;
}

static double step_size(long k, const char *kind)
{
    return kind[0] != 'i' ? 1e-3 : 1e-4 * (double)(1 + (k * 7919) % 97);
}

static double one_step(const Loop *loop, long k, double time, const char *kind)
{
    static const fmi2Integer first[MOST] = {
        1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,
        1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1,
    };
    const double h = step_size(k, kind), now = wave(k), next = wave(k + 1);
    double values[MOST], slopes[MOST], results[MOST];
    for (size_t i = 0; i < loop->input_count; i++) {
        values[i] = loop->amplitudes[i] * now;
        slopes[i] = loop->amplitudes[i] * (next - now) / h;
    }
    int bad = loop->set(loop->instance, loop->inputs, loop->input_count, values);
    if (kind[0] != 'h') {
        bad |= loop->slope(loop->instance, loop->inputs, loop->input_count, first, slopes);
    }
    bad |= loop->step(loop->instance, time, h, fmi2True);
    bad |= loop->get(loop->instance, loop->outputs, loop->output_count, results);
    if (bad) {
        stop("the FMU refused a step");
    }
    return time + h;
}

static int descending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x < y) - (x > y);
}

static void time_steps(const Loop *loop, long count, const char *kind)
{
    double time = 0.0, begin;
    double *single = (double *)malloc((size_t)count * sizeof *single);
    if (single == NULL) {
        stop("there is no memory");
    }
    for (long k = 0; k < count; k++) {
        begin = seconds();
        time = one_step(loop, k, time, kind);
        single[k] = seconds() - begin;
    }
    begin = seconds();
    for (long k = count; k < 2 * count; k++) {
        time = one_step(loop, k, time, kind);
    }
    const double mean = (seconds() - begin) / (double)count;
    qsort(single, (size_t)count, sizeof *single, descending);
    printf("%.1f %.1f %.1f\n", 1e9 * mean, 1e9 * single[count / 1000], 1e9 * single[0]);
    free(single);
}

int main(int count, char **arguments)
{
    static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
    Loop loop;
    fmi2InstantiateTYPE *instantiate;
    fmi2SetupExperimentTYPE *setup;
    fmi2EnterInitializationModeTYPE *enter;
    fmi2ExitInitializationModeTYPE *leave;
    if (count != 8) {
        stop("wrong number of arguments");
    }
    void *library = dlopen(arguments[1], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        stop(dlerror());
    }
    BIND(instantiate, library, "fmi2Instantiate");
    BIND(setup, library, "fmi2SetupExperiment");
    BIND(enter, library, "fmi2EnterInitializationMode");
    BIND(leave, library, "fmi2ExitInitializationMode");
    BIND(loop.set, library, "fmi2SetReal");
    BIND(loop.slope, library, "fmi2SetRealInputDerivatives");
    BIND(loop.step, library, "fmi2DoStep");
    BIND(loop.get, library, "fmi2GetReal");
    loop.input_count = references(arguments[5], loop.inputs);
    numbers(arguments[6], loop.amplitudes);
    loop.output_count = references(arguments[7], loop.outputs);
    loop.instance = instantiate("timed", fmi2CoSimulation, arguments[2], "", &callbacks, fmi2False, fmi2False);
    if (loop.instance == NULL || setup(loop.instance, fmi2False, 0.0, 0.0, fmi2False, 0.0) || enter(loop.instance) ||
        leave(loop.instance)) {
        stop("the FMU does not start");
    }
    time_steps(&loop, strtol(arguments[3], NULL, 10), arguments[4]);
    return 0;
}
