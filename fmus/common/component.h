/* One instance of an FMU, and the functions that its model defines. Memory contains only plain data of eight bytes each: it has
 * no padding and no pointer, so that saving, restoring and serializing an instance is one copy. */
#ifndef EIGHTPOST_COMPONENT_H
#define EIGHTPOST_COMPONENT_H

#include <float.h>
#include <stddef.h>
#include <stdint.h>

#include "interface.h"
#include "message.h"

typedef enum { INSTANTIATED = 1, INITIALIZING = 2, STEPPING = 4, TERMINATED = 8 } Phase;

typedef struct {
    int64_t phase;
    double time; /* [s] */
    double stop; /* [s]; NO_LIMIT if there is no stop time */
    int64_t stale; /* a parameter, or before the start an input, was set: the next call checks all of them */
    double slope[INPUTS]; /* first derivatives of the inputs over the next step */
    double state[STATES]; /* the model's data from step to step */
    int64_t flag[FLAGS]; /* Boolean variables */
    Values values; /* Real variables */
} Memory;

typedef enum { REAL, BOOLEAN } Kind;

#define NO_LIMIT DBL_MAX

typedef struct {
    const char *name;
    const char *unit;
    int kind;
    int index; /* in Values.at, or in Memory.flag */
    int settable; /* the phases in which a host may set it */
    int is_output;
    double minimum;
    double maximum;
} Variable;

/* Generated from interface.toml (interface.c). */
extern const Variable variables[];
extern const fmi2ValueReference input_references[INPUTS]; /* in the order of Values.at */
extern const int16_t variable_of_reference[REFERENCES]; /* -1: no such variable */
extern const int16_t real_of_reference[REFERENCES]; /* index in Values.at; -1: no such Real variable */
extern const double start_values[REALS];
extern const int64_t start_flags[FLAGS];

/* Functions that a model defines (model.c). On failure a function stores the reason in `why`. */

/* Size of data that the model keeps between steps to be faster; no result depends on them. */
size_t model_work_size(void);
/* 1 if the parameters contradict each other. */
int model_refuses(const Values *v, Message *why);
/* 1 if the parameters are unusual: a warning. */
int model_warns(const Values *v, Message *why);
/* Set outputs and state from inputs and parameters; 0 if there is no such start. */
int model_start(Memory *memory, void *work, Message *why);
/* Advance the state by h [s]; the inputs change linearly from `from` (INPUTS) to those in memory. 0 if that is not possible, or if
 * the result is not finite; then the memory is unchanged. */
int model_step(Memory *memory, const double *from, double h, void *work, Message *why);
/* An output at the end of the last step, for a model that computes outputs only when they are read. */
double model_output(const Memory *memory, int output);
/* d output / d input without delay at the current state, for two indices in Values.at. */
double model_direct_term(const Memory *memory, int output, int input);

/* The value of the Real variable with an index in Values.at. */
static inline double value_of(const Memory *memory, int index)
{
    return !OUTPUTS_ARE_KEPT && index >= INPUTS && index < INPUTS + OUTPUTS ? model_output(memory, index - INPUTS)
                                                                            : memory->values.at[index];
}

#endif
