/* FMI 3.0: types of which this FMU has no variables. An empty list is accepted, a reference is an error. */
#include "fmi3_instance.h"

fmi3Status accepts_no_other(fmi3Instance instance, const char *function, size_t n)
{
    if (core_of(instance, function) == NULL) {
        return fmi3Error;
    }
    return n == 0 ? fmi3OK : refused3(instance, function, "this FMU has no variable of that type");
}

#define NO_VARIABLES_OF(type)                                                                                     \
    fmi3Status fmi3Get##type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3##type values[], \
                             size_t n_values)                                                                     \
    {                                                                                                             \
        (void)vr;                                                                                                 \
        (void)values;                                                                                             \
        return accepts_no_other(instance, "fmi3Get" #type, n | n_values);                                         \
    }                                                                                                             \
    fmi3Status fmi3Set##type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,                      \
                             const fmi3##type values[], size_t n_values)                                          \
    {                                                                                                             \
        (void)vr;                                                                                                 \
        (void)values;                                                                                             \
        return accepts_no_other(instance, "fmi3Set" #type, n | n_values);                                         \
    }

NO_VARIABLES_OF(Float32)
NO_VARIABLES_OF(Int8)
NO_VARIABLES_OF(UInt8)
NO_VARIABLES_OF(Int16)
NO_VARIABLES_OF(UInt16)
NO_VARIABLES_OF(Int32)
NO_VARIABLES_OF(UInt32)
NO_VARIABLES_OF(Int64)
NO_VARIABLES_OF(UInt64)
NO_VARIABLES_OF(String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                         fmi3Binary values[], size_t n_values)
{
    (void)vr;
    (void)sizes;
    (void)values;
    return accepts_no_other(instance, "fmi3GetBinary", n | n_values);
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                         const fmi3Binary values[], size_t n_values)
{
    (void)vr;
    (void)sizes;
    (void)values;
    return accepts_no_other(instance, "fmi3SetBinary", n | n_values);
}

/* ---- Clocks ----------------------------------------------------------------------------------------------------------- */

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Clock values[])
{
    (void)vr;
    (void)values;
    return accepts_no_other(instance, "fmi3GetClock", n);
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[])
{
    (void)vr;
    (void)values;
    return accepts_no_other(instance, "fmi3SetClock", n);
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    (void)vr;
    (void)intervals;
    (void)qualifiers;
    return accepts_no_other(instance, "fmi3GetIntervalDecimal", n);
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    (void)vr;
    (void)counters;
    (void)resolutions;
    (void)qualifiers;
    return accepts_no_other(instance, "fmi3GetIntervalFraction", n);
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[])
{
    (void)vr;
    (void)shifts;
    return accepts_no_other(instance, "fmi3GetShiftDecimal", n);
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[])
{
    (void)vr;
    (void)counters;
    (void)resolutions;
    return accepts_no_other(instance, "fmi3GetShiftFraction", n);
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                  const fmi3Float64 intervals[])
{
    (void)vr;
    (void)intervals;
    return accepts_no_other(instance, "fmi3SetIntervalDecimal", n);
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)vr;
    (void)counters;
    (void)resolutions;
    return accepts_no_other(instance, "fmi3SetIntervalFraction", n);
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shifts[])
{
    (void)vr;
    (void)shifts;
    return accepts_no_other(instance, "fmi3SetShiftDecimal", n);
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)vr;
    (void)counters;
    (void)resolutions;
    return accepts_no_other(instance, "fmi3SetShiftFraction", n);
}
