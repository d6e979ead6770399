/* One instance as the FMI functions use it: its memory, its host's callbacks, and look-ups of its variables. */
#ifndef EIGHTPOST_INSTANCE_H
#define EIGHTPOST_INSTANCE_H

#include "component.h"

typedef struct {
    Memory memory;
    void *work;
    char *name;
    fmi2CallbackLogger logger;
    fmi2CallbackFreeMemory release;
    fmi2CallbackAllocateMemory allocate;
    fmi2ComponentEnvironment environment;
    int logging;
    int categories;
    int is_wide; /* wide.h */
    int is_model_exchange;
    uint64_t tag; /* identifies states of this FMU */
} Component;

enum { EXCHANGING = EVENT | CONTINUOUS };
enum { SETTABLE = INSTANTIATED | INITIALIZING | STEPPING | EXCHANGING };
enum { READABLE = INITIALIZING | STEPPING | EXCHANGING | TERMINATED };
enum { ALIVE = INSTANTIATED | READABLE };

/* NULL for an unknown reference. */
static inline const Variable *find_variable(fmi2ValueReference reference)
{
    const int position = reference < REFERENCES ? variable_of_reference[reference] : -1;
    return position < 0 ? NULL : &variables[position];
}

/* The variable of a reference that is known to exist. */
static inline const Variable *known_variable(fmi2ValueReference reference)
{
    return &variables[variable_of_reference[reference]];
}

/* Inputs are the first variables, so an index in `variables` is also the index in Values.at and in Memory.slope; -1 if the
 * reference is not that of an input. */
static inline int place_of_input(fmi2ValueReference reference)
{
    const uint16_t place = reference < REFERENCES ? (uint16_t)variable_of_reference[reference] : UINT16_MAX;
    return place < INPUTS ? place : -1;
}

static inline int is_input(const Variable *variable)
{
    return variable->kind == REAL && variable->index < INPUTS;
}

#endif
