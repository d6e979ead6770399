/* A small FMI 2.0 co-simulation host in C, without Python or any library: Linux, macOS and (the same source) Windows.
 *
 *     host <library> <guid> <inputs.csv> <outputs.csv> <output reference>...
 *
 * inputs.csv has a header "time,<reference>,..." and one row per communication point; inputs are held over each step. Writes the
 * outputs at every point. Exit code 0; 1 if the FMU refused a call; 2 if an argument or a file is wrong. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

#ifdef _WIN32
#include <windows.h>
typedef HMODULE Library;
static Library open_library(const char *path) { return LoadLibraryA(path); }
static FARPROC symbol(Library library, const char *name) { return GetProcAddress(library, name); }
#else
#include <dlfcn.h>
typedef void *Library;
static Library open_library(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *symbol(Library library, const char *name) { return dlsym(library, name); }
#endif

enum { MOST = 64, LINE = 4096 };

typedef struct {
    fmi2InstantiateTYPE *instantiate;
    fmi2SetupExperimentTYPE *setup;
    fmi2EnterInitializationModeTYPE *enter;
    fmi2ExitInitializationModeTYPE *leave;
    fmi2SetRealTYPE *set;
    fmi2GetRealTYPE *get;
    fmi2DoStepTYPE *step;
    fmi2TerminateTYPE *terminate;
    fmi2FreeInstanceTYPE *release;
} Functions;

typedef struct {
    fmi2ValueReference references[MOST];
    double values[MOST];
    size_t count;
} Signals;

static void stop(int code, const char *what, const char *which)
{
    fprintf(stderr, "host: %s: %s\n", what, which);
    exit(code);
}

static void check(fmi2Status status, const char *what)
{
    if (status != fmi2OK && status != fmi2Warning) {
        stop(1, "the FMU refused", what);
    }
}

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...)
{
    va_list arguments;
    (void)environment;
    va_start(arguments, message);
    fprintf(stderr, "%s [%d %s] ", name, (int)status, category);
    vfprintf(stderr, message, arguments);
    fprintf(stderr, "\n");
    va_end(arguments);
}

/* A function pointer from a symbol, without a cast that the C standard does not define. */
static void resolve(Library library, const char *name, void *function, size_t size)
{
#ifdef _WIN32
    FARPROC found = symbol(library, name);
#else
    void *found = symbol(library, name);
#endif
    if (found == NULL) {
        stop(1, "the library does not export", name);
    }
    memcpy(function, &found, size);
}

static Functions load(const char *path)
{
    Functions f;
    Library library = open_library(path);
    if (library == NULL) {
        stop(1, "the library does not load", path);
    }
    resolve(library, "fmi2Instantiate", &f.instantiate, sizeof f.instantiate);
    resolve(library, "fmi2SetupExperiment", &f.setup, sizeof f.setup);
    resolve(library, "fmi2EnterInitializationMode", &f.enter, sizeof f.enter);
    resolve(library, "fmi2ExitInitializationMode", &f.leave, sizeof f.leave);
    resolve(library, "fmi2SetReal", &f.set, sizeof f.set);
    resolve(library, "fmi2GetReal", &f.get, sizeof f.get);
    resolve(library, "fmi2DoStep", &f.step, sizeof f.step);
    resolve(library, "fmi2Terminate", &f.terminate, sizeof f.terminate);
    resolve(library, "fmi2FreeInstance", &f.release, sizeof f.release);
    return f;
}

/* Read the value references of the columns from the header, e.g. "time,0,1". */
static void read_header(FILE *file, Signals *inputs)
{
    char line[LINE];
    if (fgets(line, LINE, file) == NULL || strncmp(line, "time", 4) != 0) {
        stop(2, "the first column of the inputs must be", "time");
    }
    for (char *place = line + 4; *place == ',' && inputs->count < MOST;) {
        inputs->references[inputs->count++] = (fmi2ValueReference)strtoul(place + 1, &place, 10);
    }
}

/* Read the next row; return 1, or 0 at the end. */
static int read_row(FILE *file, double *time, Signals *inputs)
{
    char line[LINE], *place = line;
    if (fgets(line, LINE, file) == NULL) {
        return 0;
    }
    *time = strtod(place, &place);
    for (size_t k = 0; k < inputs->count; k++) {
        inputs->values[k] = strtod(place + 1, &place);
    }
    return 1;
}

static void write_row(FILE *file, double time, const Functions *f, fmi2Component c, Signals *outputs)
{
    check(f->get(c, outputs->references, outputs->count, outputs->values), "fmi2GetReal");
    fprintf(file, "%.17g", time);
    for (size_t k = 0; k < outputs->count; k++) {
        fprintf(file, ",%.17g", outputs->values[k]);
    }
    fprintf(file, "\n");
}

static void simulate(const Functions *f, fmi2Component c, FILE *in, FILE *out, Signals *inputs, Signals *outputs)
{
    double time = 0.0, next = 0.0;
    if (!read_row(in, &time, inputs)) {
        stop(2, "the inputs have no rows", "");
    }
    check(f->setup(c, fmi2False, 0.0, time, fmi2False, 0.0), "fmi2SetupExperiment");
    check(f->enter(c), "fmi2EnterInitializationMode");
    check(f->set(c, inputs->references, inputs->count, inputs->values), "fmi2SetReal");
    check(f->leave(c), "fmi2ExitInitializationMode");
    write_row(out, time, f, c, outputs);
    for (;;) {
        check(f->set(c, inputs->references, inputs->count, inputs->values), "fmi2SetReal");
        if (!read_row(in, &next, inputs)) {
            break;
        }
        check(f->step(c, time, next - time, fmi2True), "fmi2DoStep");
        time = next;
        write_row(out, time, f, c, outputs);
    }
    check(f->terminate(c), "fmi2Terminate");
}

int main(int argc, char *argv[])
{
    Signals inputs = {.count = 0}, outputs = {.count = 0};
    const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
    if (argc < 6 || argc - 5 > MOST) {
        stop(2, "usage", "host <library> <guid> <inputs.csv> <outputs.csv> <output reference>...");
    }
    for (int k = 5; k < argc; k++) {
        outputs.references[outputs.count++] = (fmi2ValueReference)strtoul(argv[k], NULL, 10);
    }
    const Functions f = load(argv[1]);
    FILE *in = fopen(argv[3], "r"), *out = fopen(argv[4], "w");
    if (in == NULL || out == NULL) {
        stop(2, "a file does not open", in == NULL ? argv[3] : argv[4]);
    }
    read_header(in, &inputs);
    fmi2Component c = f.instantiate("host", fmi2CoSimulation, argv[2], "file:///nowhere", &callbacks, fmi2False, fmi2False);
    if (c == NULL) {
        stop(1, "the FMU refused", "fmi2Instantiate");
    }
    simulate(&f, c, in, out, &inputs, &outputs);
    f.release(c);
    return fclose(out) == 0 && fclose(in) == 0 ? 0 : 2;
}
