#include "guiding.h"

#include <math.h>

/* x - s/2 where positive, from zero on by a parabola over 0 <= x <= s with the same value and slope. */
static double ramp(double x, double s, double *slope)
{
    if (x >= s) {
        *slope = 1.0;
        return x - 0.5 * s;
    }
    *slope = x / s;
    return 0.5 * x * (x / s);
}

/* 1 + u while the flange goes into the rail and 1/(1 - u) while it leaves: joined with a continuous slope,
 * never negative, so that the rail does not pull, and never giving energy. */
static double hysteresis(double u, double *slope)
{
    if (u >= 0.0) {
        *slope = 1.0;
        return 1.0 + u;
    }
    const double factor = 1.0 / (1.0 - u);
    *slope = factor * factor;
    return factor;
}

static double from_track(const double x[], const Inputs *u)
{
    return x[Y] - u->track_lateral_offset;
}

static Flange flange_contact(const Parameters *p, double y, double y_dot)
{
    static const Flange NONE = {0.0, 0.0, 0.0};
    const double side = y < 0.0 ? -1.0 : 1.0;
    const double depth = fabs(y) - p->flange_clearance;
    if (!(p->flange_stiffness > 0.0 && depth > 0.0))
        return NONE;
    double depth_slope, rate_slope;
    const double elastic = p->flange_stiffness * ramp(depth, p->flange_transition, &depth_slope);
    const double factor = hysteresis(p->flange_damping * side * y_dot, &rate_slope);
    const Flange flange = {-side * elastic * factor, -p->flange_stiffness * depth_slope * factor,
                           -elastic * p->flange_damping * rate_slope};
    return flange;
}

/* Of the cant's slope, for the mass of the wheelset. */
static double weight_across(const Parameters *p, const Inputs *u)
{
    return p->m_w * p->g * u->cant / (2.0 * p->L_g);
}

void guiding_evaluate(const Wheelset *wheelset, const double x[], Evaluation *e)
{
    const Parameters *p = &wheelset->p;
    const Inputs *u = &wheelset->u;
    const double y = from_track(x, u);
    const double N_L = fmax(e->at[LEFT].normal_load, 0.0), N_R = fmax(e->at[RIGHT].normal_load, 0.0);
    const double gravity = (N_R - N_L) * p->contact_angle - (N_R + N_L) * p->contact_angle_rate * y;
    const double curve = weight_across(p, u) - p->m_w * e->v * e->v * u->curvature;

    e->flange = flange_contact(p, y, x[Y_DOT]);
    e->guiding_force = e->flange.force + gravity + curve;
    e->guiding_moment = (N_R + N_L) * p->contact_angle * p->L_g * x[PSI];
}

void guiding_tangent(const Wheelset *wheelset, const double x[], const Evaluation *e,
                     const double d_x[], const Inputs *d_u, Evaluation *d)
{
    const Parameters *p = &wheelset->p;
    const Inputs *u = &wheelset->u;
    const double y = from_track(x, u), d_y = from_track(d_x, d_u);
    double N[2], d_N[2];
    for (int i = LEFT; i <= RIGHT; i++) {
        const int loaded = e->at[i].normal_load > 0.0;
        N[i] = loaded ? e->at[i].normal_load : 0.0;
        d_N[i] = loaded ? d->at[i].normal_load : 0.0;
    }
    const double axle = N[RIGHT] + N[LEFT], d_axle = d_N[RIGHT] + d_N[LEFT];
    const double d_gravity = (d_N[RIGHT] - d_N[LEFT]) * p->contact_angle
                             - (d_axle * y + axle * d_y) * p->contact_angle_rate;
    const double d_curve = weight_across(p, d_u)
                           - p->m_w * e->v * (2.0 * d->v * u->curvature + e->v * d_u->curvature);

    d->flange.force = e->flange.by_y * d_y + e->flange.by_y_dot * d_x[Y_DOT];
    d->guiding_force = d->flange.force + d_gravity + d_curve;
    d->guiding_moment = (d_axle * x[PSI] + axle * d_x[PSI]) * p->contact_angle * p->L_g;
}
