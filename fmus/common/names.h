/* With FMI2_FUNCTION_PREFIX set (static linking, HIL targets) every external name carries the prefix, so that several FMUs can be
 * linked into one program. */
#ifndef EIGHTPOST_NAMES_H
#define EIGHTPOST_NAMES_H

#include "fmi2Functions.h"

/* Some tools ship a fmi2Functions.h without the standard's prefix. */
#ifdef FMI2_FUNCTION_PREFIX
#undef fmi2FullName
#define EIGHTPOST_PASTE(prefix, name) prefix##name
#define EIGHTPOST_PREFIXED(prefix, name) EIGHTPOST_PASTE(prefix, name)
#define fmi2FullName(name) EIGHTPOST_PREFIXED(FMI2_FUNCTION_PREFIX, name)
#endif

#define say fmi2FullName(say)
#define say_number fmi2FullName(say_number)
#define exponential fmi2FullName(exponential)
#define exponential_minus_1 fmi2FullName(exponential_minus_1)
#define hyperbolic_tangent fmi2FullName(hyperbolic_tangent)
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
#define get_reals fmi2FullName(get_reals)
#define set_reals fmi2FullName(set_reals)
#define slopes_refused fmi2FullName(slopes_refused)
#define allocated fmi2FullName(allocated)
#define fits fmi2FullName(fits)
#define started fmi2FullName(started)
#define signals_are_finite fmi2FullName(signals_are_finite)
#define evaluated fmi2FullName(evaluated)
#define not_finite fmi2FullName(not_finite)
#define is_possible fmi2FullName(is_possible)
#define state_tag fmi2FullName(state_tag)
#define law_lag_weight fmi2FullName(law_lag_weight)
#define law_lag_weight_slope fmi2FullName(law_lag_weight_slope)
#define law_advance_lag fmi2FullName(law_advance_lag)
#define law_rate fmi2FullName(law_rate)
#define law_refuses fmi2FullName(law_refuses)

#endif
