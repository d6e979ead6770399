/* A number of one setup: double, or float in a library for large spaces. */
#ifndef EIGHTPOST_NUMBER_H
#define EIGHTPOST_NUMBER_H

#include <stdint.h>

#ifdef EIGHTPOST_SINGLE
typedef float number;
typedef int32_t integer; /* of the same size */
#define LARGEST_INTEGER INT32_MAX
#else
typedef double number;
typedef int64_t integer;
#define LARGEST_INTEGER INT64_MAX
#endif
enum { IS_DOUBLE = sizeof(number) == sizeof(double) };

#endif
