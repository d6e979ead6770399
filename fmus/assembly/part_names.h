/* The names of one part: functions of its model carry the part's kind, so that several models fit in one FMU. Everything else
 * (elementary.h, message.h) is shared. To be included first, with EIGHTPOST_PART set to the kind and an underscore. */
#ifndef EIGHTPOST_PART_NAMES_H
#define EIGHTPOST_PART_NAMES_H

#include "names.h"

#define OF_PART_PASTED(prefix, name) prefix##name
#define OF_PART_EXPANDED(prefix, name) OF_PART_PASTED(prefix, name)
#define OF_PART(name) OF_PART_EXPANDED(EIGHTPOST_PART, name)

#undef variables
#undef input_references
#undef variable_of_reference
#undef real_of_reference
#undef start_values
#undef nominal_states
#undef start_flags
#undef model_work_size
#undef model_refuses
#undef model_warns
#undef model_start
#undef model_step
#undef model_output
#undef model_state
#undef model_evaluate
#undef model_derivatives
#undef model_tangent
#undef law_start
#undef law_state
#undef law_advance
#undef law_force
#undef law_slopes
#undef law_lag_weight
#undef law_lag_weight_slope
#undef law_advance_lag
#undef law_rate
#undef law_refuses

#define variables fmi2FullName(OF_PART(variables))
#define input_references fmi2FullName(OF_PART(input_references))
#define variable_of_reference fmi2FullName(OF_PART(variable_of_reference))
#define real_of_reference fmi2FullName(OF_PART(real_of_reference))
#define start_values fmi2FullName(OF_PART(start_values))
#define nominal_states fmi2FullName(OF_PART(nominal_states))
#define start_flags fmi2FullName(OF_PART(start_flags))
#define model_work_size fmi2FullName(OF_PART(model_work_size))
#define model_refuses fmi2FullName(OF_PART(model_refuses))
#define model_warns fmi2FullName(OF_PART(model_warns))
#define model_start fmi2FullName(OF_PART(model_start))
#define model_step fmi2FullName(OF_PART(model_step))
#define model_output fmi2FullName(OF_PART(model_output))
#define model_state fmi2FullName(OF_PART(model_state))
#define model_evaluate fmi2FullName(OF_PART(model_evaluate))
#define model_derivatives fmi2FullName(OF_PART(model_derivatives))
#define model_tangent fmi2FullName(OF_PART(model_tangent))
#define law_start fmi2FullName(OF_PART(law_start))
#define law_state fmi2FullName(OF_PART(law_state))
#define law_advance fmi2FullName(OF_PART(law_advance))
#define law_force fmi2FullName(OF_PART(law_force))
#define law_slopes fmi2FullName(OF_PART(law_slopes))
#define law_lag_weight fmi2FullName(OF_PART(law_lag_weight))
#define law_lag_weight_slope fmi2FullName(OF_PART(law_lag_weight_slope))
#define law_advance_lag fmi2FullName(OF_PART(law_advance_lag))
#define law_rate fmi2FullName(OF_PART(law_rate))
#define law_refuses fmi2FullName(OF_PART(law_refuses))

#define part_size fmi2FullName(OF_PART(part_size))
#define part_load fmi2FullName(OF_PART(part_load))
#define part_store fmi2FullName(OF_PART(part_store))
#define part_values fmi2FullName(OF_PART(part_values))
#define part_refuses fmi2FullName(OF_PART(part_refuses))
#define part_warns fmi2FullName(OF_PART(part_warns))
#define part_start fmi2FullName(OF_PART(part_start))
#define part_step fmi2FullName(OF_PART(part_step))
#define part_output fmi2FullName(OF_PART(part_output))
#define part_evaluate fmi2FullName(OF_PART(part_evaluate))
#define part_derivatives fmi2FullName(OF_PART(part_derivatives))
#define part_tangent fmi2FullName(OF_PART(part_tangent))

#endif
