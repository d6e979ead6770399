/* One instance of an FMU, and the functions that its model defines. Memory contains only plain data of eight bytes each: it has
 * no padding and no pointer, so that saving, restoring and serializing an instance is one copy. */
#ifndef EIGHTPOST_COMPONENT_H
#define EIGHTPOST_COMPONENT_H

#include <float.h>
#include <stddef.h>
#include <stdint.h>

#include "interface.h"
#include "message.h"

/* Co-simulation is STEPPING between its steps; model exchange is in EVENT mode or in CONTINUOUS-time mode. */
typedef enum { INSTANTIATED = 1, INITIALIZING = 2, STEPPING = 4, TERMINATED = 8, EVENT = 16, CONTINUOUS = 32 } Phase;

/* Bits of Memory.stale: a parameter, or before the start an input, was set, and the next call checks all of them; in model exchange,
 * an input or a state was set, and the next call computes the outputs. */
enum { CHANGED = 1, MOVED = 2 };

typedef struct {
    int64_t phase;
    double time; /* [s] */
    double stop; /* [s]; NO_LIMIT if there is no stop time */
    int64_t stale; /* CHANGED, MOVED */
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
    int index; /* in Values.at; FIRST_DERIVATIVE + k, FIRST_STATE + k; or in Memory.flag */
    int settable; /* the phases in which a host may set it */
    int is_output;
    double minimum;
    double maximum;
} Variable;

/* Indices of variables that are not in Values.at: derivatives of the continuous states, and the states, which the model keeps where
 * it needs them. */
enum { FIRST_DERIVATIVE = REALS, FIRST_STATE = REALS + CONTINUOUS_STATES };

/* Generated from interface.toml (interface.c). */
extern const Variable variables[];
extern const fmi2ValueReference input_references[INPUTS]; /* in the order of Values.at */
extern const int16_t variable_of_reference[REFERENCES]; /* -1: no such variable */
extern const int16_t real_of_reference[REFERENCES]; /* index in Values.at; -1: no such Real variable */
extern const double start_values[REALS];
extern const double nominal_states[CONTINUOUS_STATES + 1]; /* of the continuous states; the last number has no use */
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
/* The place of continuous state k. */
double *model_state(Memory *memory, int k);
/* Compute outputs from inputs and continuous states. 0 if the result is not finite; then the memory is unchanged. */
int model_evaluate(Memory *memory, void *work, Message *why);
/* Derivatives of all continuous states at the end of the last step, or where the outputs were computed. */
void model_derivatives(const Memory *memory, void *work, double *rates);
/* Changes of outputs (OUTPUTS) and derivatives (CONTINUOUS_STATES) for small changes of inputs (INPUTS) and continuous states
 * (CONTINUOUS_STATES), without delay. `states` may be NULL: they do not change; `rates` may be NULL: they are not needed. */
void model_tangent(const Memory *memory, void *work, const double *inputs, const double *states, double *outputs,
                   double *rates);

/* The value of the Real variable with an index in Values.at. */
static inline double value_of(const Memory *memory, int index)
{
    return !OUTPUTS_ARE_KEPT && index >= INPUTS && index < INPUTS + OUTPUTS ? model_output(memory, index - INPUTS)
                                                                            : memory->values.at[index];
}

#endif
