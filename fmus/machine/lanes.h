/* Numbers of LANES setups at once, as the vector extensions of gcc and clang; see common/real.h. */
#ifndef EIGHTPOST_LANES_H
#define EIGHTPOST_LANES_H

#ifndef EIGHTPOST_LANES
#define EIGHTPOST_LANES /* real.h */
#endif

#include <stdint.h>
#include <string.h>

#ifdef __AVX__
#include <immintrin.h>
#endif

#include "number.h"

/* Those of 64 bytes, or of the width of the processor for a compiler that handles wider vectors badly (gcc). */
#ifndef EIGHTPOST_BYTES
#define EIGHTPOST_BYTES 64
#endif
enum { SETUPS = EIGHTPOST_BYTES / sizeof(number) };

typedef number real __attribute__((vector_size(EIGHTPOST_BYTES)));
/* Of each setup the truth of a condition or an index, as large as a number. */
typedef integer truth __attribute__((vector_size(EIGHTPOST_BYTES)));
typedef integer Index __attribute__((vector_size(EIGHTPOST_BYTES)));
/* Two numbers and two indices of each setup in single precision, and one index. */
typedef float Narrow __attribute__((vector_size(8 * SETUPS)));
typedef int32_t Places __attribute__((vector_size(8 * SETUPS)));
typedef int32_t Short __attribute__((vector_size(4 * SETUPS)));
/* A number of each setup in double precision. */
typedef double Sum __attribute__((vector_size(8 * SETUPS)));

/* The initializer of an array of zeros. */
#define ZERO {0.0}

/* Of functions that run rarely: inlined, they would take registers from those that call them. */
#define APART __attribute__((noinline))

/* Of functions that are efficient only with constant arguments. */
#define WITHIN __attribute__((always_inline))

/* Before a short loop of which every turn becomes code of its own. */
#define UNROLLED _Pragma("GCC unroll 32")

/* Keeps a variable in memory. */
#define IN_MEMORY(variable) __asm__("" : "+m"(variable))

static inline real uniform(double value)
{
    real same;
    for (int i = 0; i < SETUPS; i++) {
        same[i] = (number)value;
    }
    return same;
}

static inline real either(truth condition, real a, real b)
{
    return (real)(((truth)a & condition) | ((truth)b & ~condition));
}

/* Without the sign. */
static inline real size_of(real value)
{
    return (real)((truth)value & LARGEST_INTEGER);
}

/* One bit for each setup. */
static inline unsigned bits_of(truth condition)
{
    unsigned bits = 0;
#if defined(__AVX512DQ__) && EIGHTPOST_BYTES == 64
    bits = SETUPS == 8 ? _mm512_movepi64_mask((__m512i)condition) : _mm512_movepi32_mask((__m512i)condition);
#elif defined(__AVX__) && EIGHTPOST_BYTES >= 32
    __m256 part[EIGHTPOST_BYTES / 32];
    memcpy(part, &condition, sizeof part);
    for (int k = 0; k < EIGHTPOST_BYTES / 32; k++) {
        const int few = IS_DOUBLE ? _mm256_movemask_pd((__m256d)part[k]) : _mm256_movemask_ps(part[k]);
        bits |= (unsigned)few << 32 / sizeof(number) * k;
    }
#else
    for (int i = 0; i < SETUPS; i++) {
        bits |= (unsigned)(condition[i] & 1) << i;
    }
#endif
    return bits;
}

static inline int are_all(Places condition)
{
#if defined(__AVX512F__) && EIGHTPOST_BYTES == 64
    __m512i part[8 * SETUPS / 64];
    memcpy(part, &condition, sizeof part);
    __m512i both = part[0];
    for (int k = 1; k < 8 * SETUPS / 64; k++) {
        both &= part[k];
    }
    return _mm512_test_epi32_mask(both, both) == 0xffff;
#else
    int all = -1;
    for (int k = 0; k < 2 * SETUPS; k++) {
        all &= condition[k];
    }
    return all != 0;
#endif
}

static inline int in_any(truth condition)
{
    return bits_of(condition) != 0;
}

static inline truth one_of(truth a, truth b)
{
    return a | b;
}

static inline truth both_of(truth a, truth b)
{
    return a & b;
}

static inline truth is_false(truth condition)
{
    return ~condition;
}

static inline int in_every(truth condition)
{
    return bits_of(condition) == (1U << SETUPS) - 1U;
}

/* Four numbers of each setup, each in a row of its own, as four numbers of all. */
static inline WITHIN void transpose(const number *const *rows, real *to)
{
#if defined(__AVX512F__) && EIGHTPOST_BYTES == 64 && defined(EIGHTPOST_SINGLE)
    __m512 four[4];
    for (int k = 0; k < 4; k++) {
        four[k] = _mm512_castps128_ps512(_mm_loadu_ps(rows[k]));
        four[k] = _mm512_insertf32x4(four[k], _mm_loadu_ps(rows[k + 4]), 1);
        four[k] = _mm512_insertf32x4(four[k], _mm_loadu_ps(rows[k + 8]), 2);
        four[k] = _mm512_insertf32x4(four[k], _mm_loadu_ps(rows[k + 12]), 3);
    }
    for (int k = 0; k < 2; k++) {
        const __m512d low = (__m512d)(k == 0 ? _mm512_unpacklo_ps(four[0], four[1]) : _mm512_unpackhi_ps(four[0], four[1]));
        const __m512d high = (__m512d)(k == 0 ? _mm512_unpacklo_ps(four[2], four[3]) : _mm512_unpackhi_ps(four[2], four[3]));
        to[2 * k] = (real)_mm512_unpacklo_pd(low, high);
        to[2 * k + 1] = (real)_mm512_unpackhi_pd(low, high);
    }
#elif defined(__AVX512F__) && EIGHTPOST_BYTES == 64
    __m512d two[4];
    for (int k = 0; k < 4; k++) {
        const int first = 4 * (k / 2) + k % 2; /* with the row after the next one */
        two[k] = _mm512_insertf64x4(_mm512_castpd256_pd512(_mm256_loadu_pd(rows[first])), _mm256_loadu_pd(rows[first + 2]), 1);
    }
    for (int k = 0; k < 2; k++) {
        const __m512d low = k == 0 ? _mm512_unpacklo_pd(two[0], two[1]) : _mm512_unpackhi_pd(two[0], two[1]);
        const __m512d high = k == 0 ? _mm512_unpacklo_pd(two[2], two[3]) : _mm512_unpackhi_pd(two[2], two[3]);
        to[k] = (real)_mm512_shuffle_f64x2(low, high, 0x88);
        to[k + 2] = (real)_mm512_shuffle_f64x2(low, high, 0xdd);
    }
#else
    for (int k = 0; k < SETUPS; k++) {
        for (int c = 0; c < 4; c++) {
            to[c][k] = rows[k][c];
        }
    }
#endif
}

#endif
