/* A library for x86-64 may contain its code twice: once for every such processor, and once for processors with AVX, which add four
 * doubles at once, under names that begin with wide_. Operations and their order are the same, and so are the bits. The most costly
 * functions switch to the AVX code if the processor supports it. A compiler that is given only the files of sources/ builds the
 * first version only. */
#ifndef EIGHTPOST_WIDE_H
#define EIGHTPOST_WIDE_H

#include "instance.h"

#if defined(EIGHTPOST_WIDE) && defined(__x86_64__)

#include <cpuid.h>

fmi2Status wide_fmi2DoStep(fmi2Component instance, fmi2Real time, fmi2Real h, fmi2Boolean final);
fmi2Status wide_fmi2GetReal(fmi2Component instance, const fmi2ValueReference vr[], size_t n, fmi2Real value[]);

#define GO_ON_WIDE(instance, call)                                           \
    do {                                                                     \
        if ((instance) != NULL && ((const Component *)(instance))->is_wide) { \
            return wide_##call;                                              \
        }                                                                    \
    } while (0)

/* Whether the processor has AVX, and the operating system saves its registers for each thread. */
static inline int can_be_wide(void)
{
    const unsigned needed = bit_AVX | bit_OSXSAVE, registers = 6;
    unsigned a = 0, b = 0, c = 0, d = 0, low = 0, high = 0;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & needed) != needed) {
        return 0;
    }
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (low & registers) == registers;
}

#else

#define GO_ON_WIDE(instance, call) (void)0

static inline int can_be_wide(void)
{
    return 0;
}

#endif

#endif
