/* Functions that every kind of part defines for the assembly, and their selection by kind (part.inc defines them for one kind). */
#ifndef EIGHTPOST_PART_H
#define EIGHTPOST_PART_H

#include <stddef.h>
#include <stdint.h>

#include "message.h"

/* The saved data of one part. */
typedef struct {
    const double *moving; /* state, then signals */
    const double *parameters;
    const int64_t *flags;
    size_t flag_count;
    int64_t stale;
} Kept;

/* `named(kind, function)` is the name of a function of that kind. */
#define PART_FUNCTIONS(named, kind) \
    size_t named(kind, part_size)(void); \
    void named(kind, part_load)(void *part, const Kept *kept); \
    void named(kind, part_store)(const void *part, double *moving); \
    double *named(kind, part_values)(void *part); \
    int named(kind, part_refuses)(const double *parameters, Message *why); \
    int named(kind, part_warns)(const double *parameters, Message *why); \
    int named(kind, part_start)(void *part, Message *why); \
    int named(kind, part_step)(void *part, const double *from, double h, Message *why); \
    void named(kind, part_output)(void *part, int output); \
    int named(kind, part_evaluate)(void *part, Message *why); \
    void named(kind, part_derivatives)(void *part, double *rates); \
    void named(kind, part_tangent)(void *part, const double *inputs, const double *states, double *outputs, double *rates);

#endif
