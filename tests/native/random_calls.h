/* Random arguments and a count of calls, for the random call sequences of both FMI versions. Every thread has its own. */
#ifndef EIGHTPOST_RANDOM_CALLS_H
#define EIGHTPOST_RANDOM_CALLS_H

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "component.h"

/* Up to 1e5 s, steps longer than this [s] are made shorter: for a model whose steps take the longer the longer they are. */
#ifndef LONGEST_STEP
#define LONGEST_STEP HUGE_VAL
#endif

enum { NAMES = 64, MOST_THREADS = 64 };

typedef struct {
    const char *name;
    long called, accepted;
} Count;

static __thread uint64_t random_state;
static __thread Count counts[NAMES];

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

static void begin_randomly(uint64_t seed)
{
    random_state = UINT64_C(88172645463325252) ^ (seed * UINT64_C(0x9e3779b97f4a7c15));
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

static fmi2ValueReference an_output(void)
{
    fmi2ValueReference reference = 0;
    while (variable_of_reference[reference] < 0 || !variables[variable_of_reference[reference]].is_output) {
        reference++;
    }
    return reference;
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

/* ---- Threads ---------------------------------------------------------------------------------------------------------- */

typedef struct {
    long calls;
    uint64_t seed;
} Play;

/* Makes the calls of one thread, on instances of its own (a program defines it). */
static void *play(void *given);

/* Reads <calls> <seed> <threads>, and plays in as many threads. */
static int play_all(int argc, char *argv[])
{
    pthread_t threads[MOST_THREADS];
    Play plays[MOST_THREADS];
    const int count = argc > 3 ? atoi(argv[3]) : 1;
    for (int k = 0; k < count && k < MOST_THREADS; k++) {
        plays[k].calls = argc > 1 ? atol(argv[1]) : 10000;
        plays[k].seed = (uint64_t)(argc > 2 ? atoll(argv[2]) : 0) + (uint64_t)k;
        if (pthread_create(&threads[k], NULL, play, &plays[k]) != 0) {
            fail("pthread_create", "refused");
        }
    }
    for (int k = 0; k < count && k < MOST_THREADS; k++) {
        pthread_join(threads[k], NULL);
    }
    return 0;
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
            word[below(8)] ^= (fmi2Byte)(1 << below(8));
        } else {
            put(word, any_word());
        }
    }
    sign(bytes, size);
}

/* A state that this FMU must refuse, in memory of exactly its size: of another version, FMU or length, or any bytes. */
static fmi2Byte *foreign(const fmi2Byte *bytes, size_t *size)
{
    const size_t length = one_in(2) ? *size : (size_t)below(2 * (int)*size);
    const size_t shared = length < *size ? length : *size;
    const int header_word = below(5);
    fmi2Byte *state = malloc(length + (length == 0));
    for (size_t k = 0; k < length; k++) {
        state[k] = (fmi2Byte)random_bits();
    }
    if (!one_in(4)) {
        memcpy(state, bytes, shared);
        if (length == *size) {
            state[8 * header_word + below(8)] ^= (fmi2Byte)(1 << below(8));
        }
    }
    *size = length;
    return state;
}

#endif
