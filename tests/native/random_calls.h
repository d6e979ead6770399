/* Random arguments and a count of calls, for the random call sequences of both FMI versions. */
#ifndef EIGHTPOST_RANDOM_CALLS_H
#define EIGHTPOST_RANDOM_CALLS_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "component.h"

/* Up to 1e5 s, steps longer than this [s] are made shorter: for a model whose steps take the longer the longer they are. */
#ifndef LONGEST_STEP
#define LONGEST_STEP HUGE_VAL
#endif

enum { NAMES = 64 };

typedef struct {
    const char *name;
    long called, accepted;
} Count;

static uint64_t random_state;
static Count counts[NAMES];

static uint64_t random_bits(void)
{
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return random_state * UINT64_C(2685821657736338717);
}

static int below(int limit)
{
    return (int)(random_bits() >> 33) % limit;
}

static int one_in(int count)
{
    return below(count) == 0;
}

static double uniform(double low, double high)
{
    return low + (high - low) * (double)(random_bits() >> 11) / 9007199254740992.0;
}

static double any_number(void)
{
    static const double odd[] = {NAN, INFINITY, -INFINITY, 1e308, -1e308, 1e-320, 0.0, -0.0, -1.0, 5e-324};
    return one_in(8) ? odd[below(10)] : uniform(-1.0, 1.0) * pow(10.0, uniform(-6.0, one_in(20) ? 300.0 : 4.0));
}

static void fail(const char *function, const char *what)
{
    fprintf(stderr, "%s: %s\n", function, what);
    exit(1);
}

static void begin_randomly(int argc, char *argv[])
{
    random_state = UINT64_C(88172645463325252) ^ (argc > 2 ? (uint64_t)atoll(argv[2]) * UINT64_C(0x9e3779b97f4a7c15) : 0);
}

static void count(const char *name, int is_accepted)
{
    int k = 0;
    while (k < NAMES - 1 && counts[k].name != NULL && strcmp(counts[k].name, name) != 0) {
        k++;
    }
    counts[k].name = name;
    counts[k].called++;
    counts[k].accepted += is_accepted;
}

static void print_counts(void)
{
    for (int k = 0; k < NAMES && counts[k].name != NULL; k++) {
        printf("%-30s %8ld called %8ld accepted\n", counts[k].name, counts[k].called, counts[k].accepted);
    }
}

/* ---- Arguments ------------------------------------------------------------------------------------------------------ */

static fmi2ValueReference any_reference(void)
{
    const int reference = below(REFERENCES + 2);
    return one_in(30) ? (fmi2ValueReference)random_bits() : one_in(3) ? (fmi2ValueReference)below(INPUTS)
                                                                       : (fmi2ValueReference)reference;
}

/* Whether a value must fit to others, so that almost any other one makes the next calls fail: a curve through knots. */
static int is_part_of_a_whole(const Variable *v)
{
    return strstr(v->name, "curve.knot_") != NULL || strstr(v->name, "curve.lagged_slope") != NULL;
}

static double plausible(fmi2ValueReference reference)
{
    const Variable *v = reference < REFERENCES && variable_of_reference[reference] >= 0
                            ? &variables[variable_of_reference[reference]]
                            : NULL;
    if (v != NULL && is_part_of_a_whole(v) && !one_in(1000)) {
        return start_values[v->index];
    }
    if (v != NULL && !one_in(4)) {
        if (v->kind == REAL && v->index >= FIRST_STATE) {
            return nominal_states[v->index - FIRST_STATE] * uniform(-2.0, 2.0);
        }
        if (v->kind == REAL && v->index < REALS) {
            return start_values[v->index] * uniform(0.5, 1.5) + (v->index < INPUTS ? uniform(-1.0, 1.0) : 0.0);
        }
    }
    return any_number();
}

static void *or_null(void *pointer)
{
    return one_in(25) ? NULL : pointer;
}

static void all_finite(const char *name, const double *values, size_t n)
{
    for (size_t k = 0; k < n; k++) {
        if (!isfinite(values[k])) {
            fail(name, "gave a value that is not finite");
        }
    }
}

static double any_step(void)
{
    const double h = any_number();
    return h > LONGEST_STEP && h < 1e5 ? fmod(h, LONGEST_STEP) : h;
}

static size_t any_count(size_t right)
{
    return one_in(12) ? (size_t)below(4) : right;
}

/* ---- States that another program made --------------------------------------------------------------------------------- */

enum { HEADER = 40 }; /* bytes: tag, format, digest of the GUID, size, checksum */

static void put(fmi2Byte *bytes, uint64_t number)
{
    memcpy(bytes, &number, sizeof number);
}

/* FNV-1a of the body, begun with the digest of the GUID. */
static void sign(fmi2Byte *bytes, size_t size)
{
    uint64_t hash;
    memcpy(&hash, bytes + 16, sizeof hash);
    for (size_t k = HEADER; k < size; k++) {
        hash = (hash ^ (unsigned char)bytes[k]) * UINT64_C(1099511628211);
    }
    put(bytes + 32, hash);
}

static uint64_t any_word(void)
{
    const double number = any_number();
    uint64_t word;
    memcpy(&word, &number, sizeof word);
    return one_in(4) ? random_bits() : one_in(3) ? (uint64_t)below(12) - 2 : word;
}

static void forge(fmi2Byte *bytes, size_t size)
{
    for (int changes = 1 + below(3); changes > 0; changes--) {
        fmi2Byte *word = bytes + HEADER + 8 * (size_t)below((int)((size - HEADER) / 8));
        if (one_in(3)) {
            word[below(8)] ^= (fmi2Byte)(1 << below(7));
        } else {
            put(word, any_word());
        }
    }
    sign(bytes, size);
}

#endif
