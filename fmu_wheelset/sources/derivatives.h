/* Exact partial derivatives of the variables of a component.
 *
 * Unknowns are state derivatives and outputs, knowns are inputs and states; both by value reference. */
#ifndef DERIVATIVES_H
#define DERIVATIVES_H

#include "component.h"

typedef struct {
    const uint32_t *unknowns;
    size_t n_unknowns;
    const uint32_t *knowns;
    size_t n_knowns;
} Jacobian;

/* The Jacobian times a seed for each known: one sensitivity for each unknown. */
Status derivatives_directional(Instance *instance, const Jacobian *J, const double seed[], double sensitivity[]);

/* A seed for each unknown times the Jacobian: one sensitivity for each known. */
Status derivatives_adjoint(Instance *instance, const Jacobian *J, const double seed[], double sensitivity[]);

#endif
