/* Load the library of an FMU by its path, as a host does, drive its inputs with sines, and print its outputs after each
   step in hexadecimal. Compiled with -DFMI=2 or -DFMI=3.
   Arguments: library, GUID or token, "cs" or "me", number of continuous states, inputs as REFERENCE:AMPLITUDE,...,
   outputs as REFERENCE,... In Model Exchange the steps are those of explicit Euler. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#if FMI == 2
#include "fmi2Functions.h"
typedef fmi2Component Instance;
typedef fmi2ValueReference Reference;
#else
#include "fmi3Functions.h"
typedef fmi3Instance Instance;
typedef fmi3ValueReference Reference;
#endif

#ifdef _WIN32
#include <windows.h>
#define OPEN(path) ((void *)LoadLibraryA(path))
#define FUNCTION(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW)
#define FUNCTION(library, name) dlsym(library, name)
#endif

#define MOST 64
#define LOAD(type, name)                                                                                               \
    type *name = (type *)FUNCTION(library, #name);                                                                     \
    if (name == NULL) return 3

#if FMI == 2
static void message(fmi2ComponentEnvironment env, fmi2String name, fmi2Status status, fmi2String kind, fmi2String text, ...)
{
    (void)env;
    fprintf(stderr, "%s %d %s %s\n", name, status, kind, text);
}
#else
static void message(fmi3InstanceEnvironment env, fmi3Status status, fmi3String kind, fmi3String text)
{
    (void)env;
    fprintf(stderr, "%d %s %s\n", status, kind, text);
}
#endif

/* A rational rotation: no function of a C library enters the drive. */
static void turn(double state[2], double rate, double step)
{
    const double half = 0.5 * rate * step, divisor = 1.0 + half * half;
    const double cosine = (1.0 - half * half) / divisor, sine = 2.0 * half / divisor;
    const double first = cosine * state[0] - sine * state[1];
    state[1] = sine * state[0] + cosine * state[1];
    state[0] = first;
}

int main(int count, char **arguments)
{
    if (count != 7) return 2;
    void *library = OPEN(arguments[1]);
    if (library == NULL) return 3;
    const int exchange = strcmp(arguments[3], "me") == 0;
    const size_t states = (size_t)atoi(arguments[4]);
    Reference inputs[MOST], outputs[MOST];
    double amplitude[MOST], values[MOST], results[MOST], x[MOST], derivative[MOST];
    size_t given = 0, wanted = 0;
    for (char *word = strtok(arguments[5], ","); word != NULL; word = strtok(NULL, ",")) {
        inputs[given] = (Reference)atoi(word);
        amplitude[given++] = atof(strchr(word, ':') + 1);
    }
    for (char *word = strtok(arguments[6], ","); word != NULL; word = strtok(NULL, ","))
        outputs[wanted++] = (Reference)atoi(word);
    if (states > MOST || given > MOST || wanted > MOST) return 2;

#if FMI == 2
    LOAD(fmi2InstantiateTYPE, fmi2Instantiate);
    LOAD(fmi2SetupExperimentTYPE, fmi2SetupExperiment);
    LOAD(fmi2EnterInitializationModeTYPE, fmi2EnterInitializationMode);
    LOAD(fmi2ExitInitializationModeTYPE, fmi2ExitInitializationMode);
    LOAD(fmi2NewDiscreteStatesTYPE, fmi2NewDiscreteStates);
    LOAD(fmi2EnterContinuousTimeModeTYPE, fmi2EnterContinuousTimeMode);
    LOAD(fmi2SetTimeTYPE, fmi2SetTime);
    LOAD(fmi2GetContinuousStatesTYPE, fmi2GetContinuousStates);
    LOAD(fmi2SetContinuousStatesTYPE, fmi2SetContinuousStates);
    LOAD(fmi2GetDerivativesTYPE, fmi2GetDerivatives);
    LOAD(fmi2SetRealTYPE, fmi2SetReal);
    LOAD(fmi2GetRealTYPE, fmi2GetReal);
    LOAD(fmi2DoStepTYPE, fmi2DoStep);
    LOAD(fmi2TerminateTYPE, fmi2Terminate);
    LOAD(fmi2FreeInstanceTYPE, fmi2FreeInstance);
    const fmi2CallbackFunctions callbacks = {message, calloc, free, NULL, NULL};
    Instance fmu = fmi2Instantiate("part", exchange ? fmi2ModelExchange : fmi2CoSimulation, arguments[2], "", &callbacks,
                                   fmi2False, fmi2False);
    if (fmu == NULL) return 4;
    fmi2EventInfo event = {fmi2True, fmi2False, fmi2False, fmi2False, fmi2False, 0.0};
    int failed = fmi2SetupExperiment(fmu, fmi2False, 0.0, 0.0, fmi2False, 0.0) != fmi2OK;
    failed |= fmi2EnterInitializationMode(fmu) != fmi2OK || fmi2ExitInitializationMode(fmu) != fmi2OK;
    if (exchange) {
        failed |= fmi2NewDiscreteStates(fmu, &event) != fmi2OK || fmi2EnterContinuousTimeMode(fmu) != fmi2OK;
        failed |= fmi2GetContinuousStates(fmu, x, states) != fmi2OK;
    }
#define SET_TIME(time) fmi2SetTime(fmu, time)
#define SET_INPUTS fmi2SetReal(fmu, inputs, given, values)
#define GET_DERIVATIVES fmi2GetDerivatives(fmu, derivative, states)
#define SET_STATES fmi2SetContinuousStates(fmu, x, states)
#define DO_STEP(time, step) fmi2DoStep(fmu, time, step, fmi2True)
#define GET_OUTPUTS fmi2GetReal(fmu, outputs, wanted, results)
#define END (fmi2Terminate(fmu) != 0)
#define RELEASE fmi2FreeInstance(fmu)
#else
    LOAD(fmi3InstantiateCoSimulationTYPE, fmi3InstantiateCoSimulation);
    LOAD(fmi3InstantiateModelExchangeTYPE, fmi3InstantiateModelExchange);
    LOAD(fmi3EnterInitializationModeTYPE, fmi3EnterInitializationMode);
    LOAD(fmi3ExitInitializationModeTYPE, fmi3ExitInitializationMode);
    LOAD(fmi3EnterContinuousTimeModeTYPE, fmi3EnterContinuousTimeMode);
    LOAD(fmi3SetTimeTYPE, fmi3SetTime);
    LOAD(fmi3GetContinuousStatesTYPE, fmi3GetContinuousStates);
    LOAD(fmi3SetContinuousStatesTYPE, fmi3SetContinuousStates);
    LOAD(fmi3GetContinuousStateDerivativesTYPE, fmi3GetContinuousStateDerivatives);
    LOAD(fmi3SetFloat64TYPE, fmi3SetFloat64);
    LOAD(fmi3GetFloat64TYPE, fmi3GetFloat64);
    LOAD(fmi3DoStepTYPE, fmi3DoStep);
    LOAD(fmi3TerminateTYPE, fmi3Terminate);
    LOAD(fmi3FreeInstanceTYPE, fmi3FreeInstance);
    Instance fmu = exchange ? fmi3InstantiateModelExchange("part", arguments[2], "", false, false, NULL, message)
                            : fmi3InstantiateCoSimulation("part", arguments[2], "", false, false, false, false, NULL, 0,
                                                          NULL, message, NULL);
    if (fmu == NULL) return 4;
    bool event, terminate, early;
    double last;
    int failed = fmi3EnterInitializationMode(fmu, false, 0.0, 0.0, false, 0.0) != fmi3OK;
    failed |= fmi3ExitInitializationMode(fmu) != fmi3OK;
    if (exchange) {
        failed |= fmi3EnterContinuousTimeMode(fmu) != fmi3OK;
        failed |= fmi3GetContinuousStates(fmu, x, states) != fmi3OK;
    }
#define SET_TIME(time) fmi3SetTime(fmu, time)
#define SET_INPUTS fmi3SetFloat64(fmu, inputs, given, values, given)
#define GET_DERIVATIVES fmi3GetContinuousStateDerivatives(fmu, derivative, states)
#define SET_STATES fmi3SetContinuousStates(fmu, x, states)
#define DO_STEP(time, step) fmi3DoStep(fmu, time, step, true, &event, &terminate, &early, &last)
#define GET_OUTPUTS fmi3GetFloat64(fmu, outputs, wanted, results, wanted)
#define END (fmi3Terminate(fmu) != 0)
#define RELEASE fmi3FreeInstance(fmu)
#endif

    const double step = exchange ? 1e-4 : 1e-3, rate = 64.0;
    double drive[2] = {1.0, 0.0};
    for (int k = 0; k < 1000 && !failed; ++k) {
        turn(drive, rate, step);
        for (size_t i = 0; i < given; ++i) values[i] = amplitude[i] * drive[i % 2];
        if (exchange) failed |= SET_TIME(k * step) != 0;
        failed |= SET_INPUTS != 0;
        if (exchange && states > 0) {
            failed |= GET_DERIVATIVES != 0;
            for (size_t i = 0; i < states; ++i) x[i] += step * derivative[i];
            failed |= SET_TIME((k + 1) * step) != 0 || SET_STATES != 0;
        }
        if (!exchange) failed |= DO_STEP(k * step, step) != 0;
        failed |= GET_OUTPUTS != 0;
        for (size_t i = 0; i < wanted; ++i) printf("%a\n", results[i]);
    }
    failed |= END;
    RELEASE;
    return failed ? 5 : 0;
}
