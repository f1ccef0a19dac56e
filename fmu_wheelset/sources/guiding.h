/* What guides the wheelset besides the creep forces: flange contact, gravitational stiffness and the curve. */
#ifndef GUIDING_H
#define GUIDING_H

#include "wheelset.h"

/* Fill `flange`, `guiding_force` and `guiding_moment` of `e`; its speed and normal loads are known. */
void guiding_evaluate(const Wheelset *wheelset, const double x[], Evaluation *e);

/* Fill `guiding_force`, `guiding_moment` and the force of `flange` in `d` with directional derivatives. */
void guiding_tangent(const Wheelset *wheelset, const double x[], const Evaluation *e,
                     const double d_x[], const Inputs *d_u, Evaluation *d);

#endif
