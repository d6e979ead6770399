/* Load the library of an FMU by its path, as a host does, drive a shock, and print the force of each step in hexadecimal.
   Arguments: library, GUID, instance name, value references of velocity, displacement and force. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include "fmi2Functions.h"

#ifdef _WIN32
#include <windows.h>
#define OPEN(path) ((void *)LoadLibraryA(path))
#define FUNCTION(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW)
#define FUNCTION(library, name) dlsym(library, name)
#endif

static void message(fmi2ComponentEnvironment env, fmi2String name, fmi2Status status, fmi2String kind, fmi2String text, ...)
{
    (void)env;
    fprintf(stderr, "%s %d %s %s\n", name, status, kind, text);
}

#define LOAD(type, name)                                                                                               \
    type *name = (type *)FUNCTION(library, #name);                                                                     \
    if (name == NULL) return 3

int main(int count, char **arguments)
{
    if (count != 7) return 2;
    void *library = OPEN(arguments[1]);
    if (library == NULL) return 3;
    LOAD(fmi2InstantiateTYPE, fmi2Instantiate);
    LOAD(fmi2SetupExperimentTYPE, fmi2SetupExperiment);
    LOAD(fmi2EnterInitializationModeTYPE, fmi2EnterInitializationMode);
    LOAD(fmi2ExitInitializationModeTYPE, fmi2ExitInitializationMode);
    LOAD(fmi2SetRealTYPE, fmi2SetReal);
    LOAD(fmi2GetRealTYPE, fmi2GetReal);
    LOAD(fmi2DoStepTYPE, fmi2DoStep);
    LOAD(fmi2TerminateTYPE, fmi2Terminate);
    LOAD(fmi2FreeInstanceTYPE, fmi2FreeInstance);
    const fmi2CallbackFunctions callbacks = {message, calloc, free, NULL, NULL};
    fmi2Component shock =
        fmi2Instantiate(arguments[3], fmi2CoSimulation, arguments[2], "", &callbacks, fmi2False, fmi2False);
    if (shock == NULL) return 4;
    const fmi2ValueReference inputs[2] = {(unsigned)atoi(arguments[4]), (unsigned)atoi(arguments[5])};
    const fmi2ValueReference output = (unsigned)atoi(arguments[6]);
    const double step = 1e-3, speed = 0.5, rate = 64.0;
    double state[2] = {speed, 0.0}; /* a rational rotation: no function of a C library enters the drive */
    int failed = fmi2SetupExperiment(shock, fmi2False, 0.0, 0.0, fmi2False, 0.0) != fmi2OK;
    failed |= fmi2EnterInitializationMode(shock) != fmi2OK || fmi2ExitInitializationMode(shock) != fmi2OK;
    for (int k = 0; k < 1000 && !failed; ++k) {
        const double half = 0.5 * rate * step, divisor = 1.0 + half * half;
        const double cosine = (1.0 - half * half) / divisor, sine = 2.0 * half / divisor;
        const double turned[2] = {cosine * state[0] - sine * state[1], sine * state[0] + cosine * state[1]};
        state[0] = turned[0];
        state[1] = turned[1];
        const double values[2] = {state[0], state[1] / rate};
        double force;
        failed |= fmi2SetReal(shock, inputs, 2, values) != fmi2OK;
        failed |= fmi2DoStep(shock, k * step, step, fmi2True) != fmi2OK;
        failed |= fmi2GetReal(shock, &output, 1, &force) != fmi2OK;
        printf("%a\n", force);
    }
    failed |= fmi2Terminate(shock) != fmi2OK;
    fmi2FreeInstance(shock);
    return failed ? 5 : 0;
}
