/* The functions of a part selected by its kind, which is known when the assembly is built. */
#ifndef EIGHTPOST_PART_KINDS_H
#define EIGHTPOST_PART_KINDS_H

#include "assembly_data.h"
#include "part.h"

#define NAMED(kind, function) fmi2FullName(kind##_##function)
#define DECLARE(kind) PART_FUNCTIONS(NAMED, kind)
PART_KINDS(DECLARE)

#define CASE_SIZE(kind) case KIND_##kind: return NAMED(kind, part_size)();
#define CASE_LOAD(kind) case KIND_##kind: NAMED(kind, part_load)(part, kept); break;
#define CASE_STORE(kind) case KIND_##kind: NAMED(kind, part_store)(part, moving); break;
#define CASE_VALUES(kind) case KIND_##kind: return NAMED(kind, part_values)(part);
#define CASE_REFUSES(kind) case KIND_##kind: return NAMED(kind, part_refuses)(parameters, why);
#define CASE_WARNS(kind) case KIND_##kind: return NAMED(kind, part_warns)(parameters, why);
#define CASE_START(kind) case KIND_##kind: return NAMED(kind, part_start)(part, why);
#define CASE_STEP(kind) case KIND_##kind: return NAMED(kind, part_step)(part, from, h, why);
#define CASE_OUTPUT(kind) case KIND_##kind: NAMED(kind, part_output)(part, output); break;
#define CASE_EVALUATE(kind) case KIND_##kind: return NAMED(kind, part_evaluate)(part, why);
#define CASE_DERIVATIVES(kind) case KIND_##kind: NAMED(kind, part_derivatives)(part, rates); break;
#define CASE_TANGENT(kind) case KIND_##kind: NAMED(kind, part_tangent)(part, inputs, states, outputs, rates); break;

static inline size_t size_of_part(int kind)
{
    switch (kind) { PART_KINDS(CASE_SIZE) default: return 0; }
}

static inline void load(int kind, void *part, const Kept *kept)
{
    switch (kind) { PART_KINDS(CASE_LOAD) default: break; }
}

static inline void store(int kind, const void *part, double *moving)
{
    switch (kind) { PART_KINDS(CASE_STORE) default: break; }
}

static inline double *values_of(int kind, void *part)
{
    switch (kind) { PART_KINDS(CASE_VALUES) default: return NULL; }
}

static inline int refuses(int kind, const double *parameters, Message *why)
{
    switch (kind) { PART_KINDS(CASE_REFUSES) default: return 0; }
}

static inline int warns(int kind, const double *parameters, Message *why)
{
    switch (kind) { PART_KINDS(CASE_WARNS) default: return 0; }
}

static inline int start(int kind, void *part, Message *why)
{
    switch (kind) { PART_KINDS(CASE_START) default: return 0; }
}

static inline int step(int kind, void *part, const double *from, double h, Message *why)
{
    switch (kind) { PART_KINDS(CASE_STEP) default: return 0; }
}

static inline void compute_output(int kind, void *part, int output)
{
    switch (kind) { PART_KINDS(CASE_OUTPUT) default: break; }
}

static inline int evaluate(int kind, void *part, Message *why)
{
    switch (kind) { PART_KINDS(CASE_EVALUATE) default: return 0; }
}

static inline void compute_derivatives(int kind, void *part, double *rates)
{
    switch (kind) { PART_KINDS(CASE_DERIVATIVES) default: break; }
}

static inline void compute_tangent(int kind, void *part, const double *inputs, const double *states, double *outputs,
                                   double *rates)
{
    switch (kind) { PART_KINDS(CASE_TANGENT) default: break; }
}

#endif
