/* Model exchange: the states and their derivatives, for an integrator outside.
 *
 * All states are announced in every drive mode; those that do not move have the derivative 0. There are no
 * events: drive mode and forward dynamics are fixed, and inputs may jump where the integrator is restarted. */
#ifndef EXCHANGE_H
#define EXCHANGE_H

#include "component.h"

/* As component_require, for instances of model exchange only. */
Status exchange_require(Instance *instance, int phases, const char *function);

Status exchange_set_time(Instance *instance, double time);

/* STATUS_DISCARD, with nothing changed, where a value is not finite: the integrator may try a smaller step. */
Status exchange_set_states(Instance *instance, const double x[], size_t n);
Status exchange_get_states(Instance *instance, double x[], size_t n);
Status exchange_get_derivatives(Instance *instance, double x_dot[], size_t n);
Status exchange_get_nominals(Instance *instance, double nominals[], size_t n);

/* There are none. */
Status exchange_get_indicators(Instance *instance, size_t n);

#endif
