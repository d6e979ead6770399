/* External names. Every name carries the prefix FMI2_FUNCTION_PREFIX if it is set, so that several FMUs fit in one program. By
 * default it is the model identifier and an underscore, or nothing in a shared library (prefix.h). A host that defines
 * FMI2_FUNCTION_PREFIX, possibly as nothing, sets another one. With FMI2_OVERRIDE_FUNCTION_PREFIX, as in the headers of FMI 3.0,
 * the prefix is FMI2_ACTUAL_FUNCTION_PREFIX if that is defined, otherwise nothing. */
#ifndef EIGHTPOST_NAMES_H
#define EIGHTPOST_NAMES_H

#include "prefix.h"

#if defined(FMI2_OVERRIDE_FUNCTION_PREFIX)
#undef FMI2_FUNCTION_PREFIX
#if defined(FMI2_ACTUAL_FUNCTION_PREFIX)
#define FMI2_FUNCTION_PREFIX FMI2_ACTUAL_FUNCTION_PREFIX
#endif
#endif

#include "fmi2Functions.h"

/* Some tools ship a fmi2Functions.h without the standard's prefix. */
#ifdef FMI2_FUNCTION_PREFIX
#undef fmi2FullName
#define EIGHTPOST_PASTE(prefix, name) prefix##name
#define EIGHTPOST_PREFIXED(prefix, name) EIGHTPOST_PASTE(prefix, name)
#define fmi2FullName(name) EIGHTPOST_PREFIXED(FMI2_FUNCTION_PREFIX, name)
#endif

/* No fused multiply-add, so that all processors give the same bits; gcc needs -ffp-contract=off or -std=c99. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#endif

#define say fmi2FullName(say)
#define say_number fmi2FullName(say_number)
#define exponential fmi2FullName(exponential)
#define exponential_minus_1 fmi2FullName(exponential_minus_1)
#define hyperbolic_tangent fmi2FullName(hyperbolic_tangent)
#define logarithm fmi2FullName(logarithm)
#define sine_and_cosine fmi2FullName(sine_and_cosine)
#define variables fmi2FullName(variables)
#define input_references fmi2FullName(input_references)
#define variable_of_reference fmi2FullName(variable_of_reference)
#define real_of_reference fmi2FullName(real_of_reference)
#define start_values fmi2FullName(start_values)
#define nominal_states fmi2FullName(nominal_states)
#define start_flags fmi2FullName(start_flags)
#define model_work_size fmi2FullName(model_work_size)
#define model_refuses fmi2FullName(model_refuses)
#define model_warns fmi2FullName(model_warns)
#define model_start fmi2FullName(model_start)
#define model_step fmi2FullName(model_step)
#define model_output fmi2FullName(model_output)
#define model_state fmi2FullName(model_state)
#define model_evaluate fmi2FullName(model_evaluate)
#define model_derivatives fmi2FullName(model_derivatives)
#define model_tangent fmi2FullName(model_tangent)
#define logged fmi2FullName(logged)
#define refused fmi2FullName(refused)
#define out_of_phase fmi2FullName(out_of_phase)
#define not_known fmi2FullName(not_known)
#define not_settable fmi2FullName(not_settable)
#define out_of_range fmi2FullName(out_of_range)
#define all_known fmi2FullName(all_known)
#define derivable fmi2FullName(derivable)
#define get_reals fmi2FullName(get_reals)
#define set_reals fmi2FullName(set_reals)
#define slopes_refused fmi2FullName(slopes_refused)
#define allocated fmi2FullName(allocated)
#define fits fmi2FullName(fits)
#define started fmi2FullName(started)
#define is_next_step fmi2FullName(is_next_step)
#define signals_are_finite fmi2FullName(signals_are_finite)
#define start_over fmi2FullName(start_over)
#define updated fmi2FullName(updated)
#define not_finite fmi2FullName(not_finite)
#define is_possible fmi2FullName(is_possible)
#define law_start fmi2FullName(law_start)
#define law_state fmi2FullName(law_state)
#define law_advance fmi2FullName(law_advance)
#define law_force fmi2FullName(law_force)
#define law_slopes fmi2FullName(law_slopes)
#define law_lag_weight fmi2FullName(law_lag_weight)
#define law_lag_weight_slope fmi2FullName(law_lag_weight_slope)
#define law_advance_lag fmi2FullName(law_advance_lag)
#define law_rate fmi2FullName(law_rate)
#define law_refuses fmi2FullName(law_refuses)

#endif
