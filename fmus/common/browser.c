/* An FMU as a WebAssembly module for a page: one instance, and functions whose arguments and results are plain numbers. The FMU
 * itself is the code of the native binary; a build for a page adds this file. */
#include <stdlib.h>
#include <string.h>

#include "calls.h"

#if defined(__wasm__)
#define EXPORTED(name) __attribute__((export_name(#name)))

/* What an FMU needs of the C library; the compiler provides the rest. The memory of the one instance is never returned. */

enum { MOST_DOUBLES = 1 << 16 };

void *calloc(size_t count, size_t size)
{
    static double memory[MOST_DOUBLES];
    static size_t used;
    const size_t needed = (count * size + sizeof *memory - 1) / sizeof *memory, begin = used;
    if (needed > MOST_DOUBLES - used) {
        return NULL;
    }
    used += needed;
    return memory + begin;
}

void free(void *memory)
{
    (void)memory;
}

int strcmp(const char *a, const char *b)
{
    while (*a != '\0' && *a == *b) {
        a++;
        b++;
    }
    return (unsigned char)*a - (unsigned char)*b;
}

#else
#define EXPORTED(name)
#endif

static fmi2Component instance;
static char message[512]; /* of the last warning or error */

static void keep_message(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                         fmi2String text, ...)
{
    const size_t length = strlen(text), most = sizeof message - 1, kept = length < most ? length : most;
    (void)environment;
    (void)name;
    (void)status;
    (void)category;
    memcpy(message, text, kept); /* our messages contain no format */
    message[kept] = '\0';
}

static double of(fmi2Status status)
{
    return status <= fmi2Warning ? 1.0 : 0.0;
}

double page_open(void);
double page_set(double reference, double value);
double page_set_flag(double reference, double value);
double page_get(double reference);
double page_start(void);
double page_slope(double reference, double value);
double page_step(double time, double h);
const char *page_message(void);

/* A new or reset instance; each function returns 1 if the FMU did it, otherwise 0. */
EXPORTED(page_open) double page_open(void)
{
    static const fmi2CallbackFunctions functions = {keep_message, NULL, NULL, NULL, NULL};
    message[0] = '\0';
    if (instance != NULL) {
        return of(fmi2Reset(instance));
    }
    instance = fmi2Instantiate("page", fmi2CoSimulation, MODEL_GUID, "", &functions, fmi2False, fmi2False);
    return instance != NULL ? 1.0 : 0.0;
}

EXPORTED(page_set) double page_set(double reference, double value)
{
    const fmi2ValueReference vr = (fmi2ValueReference)reference;
    return of(fmi2SetReal(instance, &vr, 1, &value));
}

EXPORTED(page_set_flag) double page_set_flag(double reference, double value)
{
    const fmi2ValueReference vr = (fmi2ValueReference)reference;
    const fmi2Boolean flag = value != 0.0;
    return of(fmi2SetBoolean(instance, &vr, 1, &flag));
}

/* The variable's value; NaN if the FMU does not give it. */
EXPORTED(page_get) double page_get(double reference)
{
    const fmi2ValueReference vr = (fmi2ValueReference)reference;
    double value = 0.0;
    return fmi2GetReal(instance, &vr, 1, &value) <= fmi2Warning ? value : 0.0 / 0.0;
}

EXPORTED(page_start) double page_start(void)
{
    return fmi2SetupExperiment(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0) <= fmi2Warning &&
                   fmi2EnterInitializationMode(instance) <= fmi2Warning
               ? of(fmi2ExitInitializationMode(instance))
               : 0.0;
}

/* The derivative of an input over the next step. */
EXPORTED(page_slope) double page_slope(double reference, double value)
{
    const fmi2ValueReference vr = (fmi2ValueReference)reference;
    const fmi2Integer order = 1;
    return of(fmi2SetRealInputDerivatives(instance, &vr, 1, &order, &value));
}

EXPORTED(page_step) double page_step(double time, double h)
{
    return of(fmi2DoStep(instance, time, h, fmi2True));
}

EXPORTED(page_message) const char *page_message(void)
{
    return message;
}
