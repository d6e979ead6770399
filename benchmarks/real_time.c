/* Runs coupled FMUs as a hardware-in-the-loop simulator does; benchmarks/real_time.py compiles and runs it.
 *
 *     real_time <seconds> <rate in Hz> <passes>  < system
 *
 * A step sets the inputs, calls fmi2DoStep and gets the outputs of each FMU, in the order of the file. First one pass is paced:
 * each step waits for its time, with the processor kept busy. Then the same steps are repeated without waiting; the minimum over
 * these passes is the cost of the step itself. Last, a child process makes steps under a filter that stops every system call.
 *
 * The system on the standard input has for each FMU a line `<library> <guid> <inputs> <outputs>`; then a line for each input,
 * `<reference> <amplitude> <FMU> <output>`: the source, or -1 for a triangle; then a line `<reference>` for each output. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "fmi2Functions.h"

enum { MOST_FMUS = 8, MOST = 64, PERIOD = 200 };

typedef struct {
    fmi2SetRealTYPE *set;
    fmi2DoStepTYPE *step;
    fmi2GetRealTYPE *get;
    fmi2GetFMUstateTYPE *save;
    fmi2SetFMUstateTYPE *restore;
    fmi2Component instance;
    fmi2FMUstate begin;
    size_t input_count, output_count;
    fmi2ValueReference inputs[MOST], outputs[MOST];
    double amplitudes[MOST], values[MOST], results[MOST];
    int source[MOST], place[MOST];
} Unit;

typedef struct {
    Unit unit[MOST_FMUS];
    int count;
} System;

/* ---- Counters: allocations of this process, of which the FMUs' are a part ---- */

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *memory, size_t size);

static volatile long allocations;

void *malloc(size_t size)
{
    allocations++;
    return __libc_malloc(size);
}

void *calloc(size_t count, size_t size)
{
    allocations++;
    return __libc_calloc(count, size);
}

void *realloc(void *memory, size_t size)
{
    allocations++;
    return __libc_realloc(memory, size);
}

static long page_faults(void)
{
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    return usage.ru_minflt + usage.ru_majflt;
}

/* ---- The system ---- */

static void stop(const char *what)
{
    fprintf(stderr, "real_time: %s\n", what);
    exit(1);
}

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    (void)environment;
    (void)category;
    fprintf(stderr, "%s [%d]: %s\n", name, (int)status, message);
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

static void open_library(Unit *unit, const char *path, const char *guid)
{
    static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
    fmi2InstantiateTYPE *instantiate;
    fmi2SetupExperimentTYPE *setup;
    fmi2EnterInitializationModeTYPE *enter;
    fmi2ExitInitializationModeTYPE *leave;
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        stop(dlerror());
    }
    BIND(instantiate, library, "fmi2Instantiate");
    BIND(setup, library, "fmi2SetupExperiment");
    BIND(enter, library, "fmi2EnterInitializationMode");
    BIND(leave, library, "fmi2ExitInitializationMode");
    BIND(unit->set, library, "fmi2SetReal");
    BIND(unit->step, library, "fmi2DoStep");
    BIND(unit->get, library, "fmi2GetReal");
    BIND(unit->save, library, "fmi2GetFMUstate");
    BIND(unit->restore, library, "fmi2SetFMUstate");
    unit->instance = instantiate("one", fmi2CoSimulation, guid, "", &callbacks, fmi2False, fmi2False);
    if (unit->instance == NULL || setup(unit->instance, fmi2False, 0.0, 0.0, fmi2False, 0.0) ||
        enter(unit->instance) || leave(unit->instance) || unit->save(unit->instance, &unit->begin)) {
        stop("an FMU does not start");
    }
}

static int read_unit(Unit *unit)
{
    char path[4096], guid[128];
    if (scanf("%4095s %127s %zu %zu", path, guid, &unit->input_count, &unit->output_count) != 4) {
        return 0;
    }
    if (unit->input_count > MOST || unit->output_count > MOST) {
        stop("an FMU has too many variables");
    }
    for (size_t k = 0; k < unit->input_count; k++) {
        if (scanf("%u %lf %d %d", &unit->inputs[k], &unit->amplitudes[k], &unit->source[k], &unit->place[k]) != 4) {
            stop("a line of an input has not four numbers");
        }
    }
    for (size_t k = 0; k < unit->output_count; k++) {
        if (scanf("%u", &unit->outputs[k]) != 1) {
            stop("a line of an output has no number");
        }
    }
    open_library(unit, path, guid);
    return 1;
}

/* A triangle between -1 and 1. */
static double wave(long k)
{
    const long phase = k % PERIOD, half = PERIOD / 2;
    return 2.0 * (double)(phase < half ? phase : PERIOD - phase) / (double)half - 1.0;
}

static int one_step(System *system, long k, double h)
{
    int bad = 0;
    for (int u = 0; u < system->count; u++) {
        Unit *unit = &system->unit[u];
        for (size_t i = 0; i < unit->input_count; i++) {
            const int source = unit->source[i];
            unit->values[i] = unit->amplitudes[i] *
                              (source < 0 ? wave(k) : system->unit[source].results[unit->place[i]]);
        }
        bad |= unit->set(unit->instance, unit->inputs, unit->input_count, unit->values);
        bad |= unit->step(unit->instance, (double)k * h, h, fmi2True);
        bad |= unit->get(unit->instance, unit->outputs, unit->output_count, unit->results);
    }
    return bad;
}

static void start_over(System *system)
{
    for (int u = 0; u < system->count; u++) {
        memset(system->unit[u].results, 0, sizeof system->unit[u].results);
        if (system->unit[u].restore(system->unit[u].instance, system->unit[u].begin)) {
            stop("an FMU does not return to its start");
        }
    }
}

/* ---- Time ---- */

static int64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time); /* no system call: the kernel maps its clock into the process */
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

static void print_distribution(const char *name, int64_t *cost, long count)
{
    static const int64_t edges[] = {100, 200, 500, 1000, 2000, 5000, 10000, 100000, 1000000};
    enum { EDGES = sizeof edges / sizeof edges[0] };
    long counts[EDGES + 1] = {0};
    qsort(cost, (size_t)count, sizeof *cost, ascending);
    for (long k = 0, bin = 0; k < count; k++) {
        while (bin < EDGES && cost[k] >= edges[bin]) {
            bin++;
        }
        counts[bin]++;
    }
    printf("%s %ld %ld %ld %ld", name, (long)cost[count / 2], (long)cost[count - 1 - count / 100],
           (long)cost[count - 1 - count / 10000], (long)cost[count - 1]);
    for (int bin = 0; bin <= EDGES; bin++) {
        printf(" %ld", counts[bin]);
    }
    printf("\n");
}

/* ---- Passes ---- */

typedef struct {
    long count;
    double h;
    int64_t *cost;
} Steps;

static void paced(System *system, const Steps *steps)
{
    const int64_t period = (int64_t)(1e9 * steps->h);
    long late = 0;
    for (long k = 0; k < 1000 && k < steps->count; k++) { /* so that code and data are in memory */
        one_step(system, k, steps->h);
    }
    start_over(system);
    memset(steps->cost, 1, (size_t)steps->count * sizeof *steps->cost);
    const long allocated = allocations, faults = page_faults();
    int64_t due = now();
    int bad = 0;
    for (long k = 0; k < steps->count; k++, due += period) {
        int64_t begin = now();
        while (begin < due) {
            begin = now();
        }
        if (begin - due > period) { /* another process had the processor: go on from here */
            late++;
            due = begin;
        }
        bad |= one_step(system, k, steps->h);
        steps->cost[k] = now() - begin;
    }
    const long more_faults = page_faults() - faults, more_allocated = allocations - allocated;
    if (bad) {
        stop("an FMU refused a step");
    }
    printf("steps %ld\nallocations %ld %ld\npage_faults %ld\nlate %ld\n", steps->count, more_allocated, allocated,
           more_faults, late);
    print_distribution("paced", steps->cost, steps->count);
}

static void repeated(System *system, const Steps *steps, long passes)
{
    for (long k = 0; k < steps->count; k++) {
        steps->cost[k] = INT64_MAX;
    }
    for (long pass = 0; pass < passes; pass++) {
        start_over(system);
        for (long k = 0; k < steps->count; k++) {
            const int64_t begin = now();
            one_step(system, k, steps->h);
            const int64_t cost = now() - begin;
            steps->cost[k] = cost < steps->cost[k] ? cost : steps->cost[k];
        }
    }
    print_distribution("minimum", steps->cost, steps->count);
}

static void print_clock(void)
{
    int64_t least = INT64_MAX;
    for (int k = 0; k < 10000; k++) {
        const int64_t begin = now(), cost = now() - begin;
        least = cost < least ? cost : least;
    }
    printf("clock %ld\n", (long)least);
}

/* ---- System calls ---- */

static volatile sig_atomic_t calls;

static void count_call(int number)
{
    (void)number;
    calls++;
}

/* From here on, every system call except those that end this process raises SIGSYS. */
static int stop_system_calls(void)
{
    struct sock_filter code[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_write, 3, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_exit_group, 2, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_rt_sigreturn, 1, 0),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRAP),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    const struct sock_fprog program = {sizeof code / sizeof code[0], code};
    signal(SIGSYS, count_call);
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0;
}

/* Prints the number of system calls in all steps, and then with one more call, which shows that they are counted. */
static void count_system_calls(System *system, const Steps *steps)
{
    char text[64];
    fflush(stdout);
    if (fork() == 0) {
        start_over(system);
        if (!stop_system_calls()) {
            _exit(1);
        }
        for (long k = 0; k < steps->count; k++) {
            one_step(system, k, steps->h);
        }
        const int in_steps = calls;
        syscall(SYS_getppid);
        const int length = snprintf(text, sizeof text, "system_calls %d %d\n", in_steps, (int)calls - in_steps);
        _exit(write(STDOUT_FILENO, text, (size_t)length) != length);
    }
    int status = 0;
    if (wait(&status) < 0 || status != 0) {
        printf("system_calls -1 0\n");
    }
}

int main(int count, char **arguments)
{
    static System system;
    if (count != 4) {
        stop("usage: real_time <seconds> <rate in Hz> <passes> < system");
    }
    const double seconds = strtod(arguments[1], NULL), rate = strtod(arguments[2], NULL);
    while (system.count < MOST_FMUS && read_unit(&system.unit[system.count])) {
        system.count++;
    }
    const Steps steps = {(long)(seconds * rate), 1.0 / rate,
                         (int64_t *)malloc((size_t)(seconds * rate) * sizeof(int64_t))};
    if (system.count == 0 || steps.cost == NULL || steps.count < 1) {
        stop("there is no FMU, no step or no memory");
    }
    print_clock();
    paced(&system, &steps);
    repeated(&system, &steps, strtol(arguments[3], NULL, 10));
    count_system_calls(&system, &steps);
    return 0;
}
