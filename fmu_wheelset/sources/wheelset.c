#include "wheelset.h"

#include "elementary.h"
#include "guiding.h"

#include <math.h>

/* v_r = |v|, continued below v0 by a parabola with the same value and slope, so that 1/v_r stays finite. */
static double regularised_speed(double v, double v0, double *slope)
{
    if (fabs(v) >= v0) {
        *slope = v < 0.0 ? -1.0 : 1.0;
        return fabs(v);
    }
    *slope = v / v0;
    return (v * v + v0 * v0) / (2.0 * v0);
}

static double forward_speed(const Wheelset *wheelset, const double x[])
{
    return wheelset->p.forward_dynamics ? x[V] : wheelset->u.speed;
}

static double rolling_radius(const Parameters *p, int side)
{
    return side == LEFT ? p->r0 + 0.5 * p->delta_r : p->r0 - 0.5 * p->delta_r;
}

/* By which the radii differ from r0 where no wheel speeds tell them apart: wheels fixed to one axle. */
static double unequal_radii(const Parameters *p)
{
    return p->drive_mode == TORQUE_DRIVEN ? 0.0 : 0.5 * p->delta_r;
}

void wheelset_initialise(Wheelset *wheelset)
{
    const Parameters *p = &wheelset->p;
    const double v = wheelset->u.speed;
    double slope;
    const double v_r = regularised_speed(v, p->v0, &slope);
    wheelset->x[V] = v;
    for (int i = LEFT; i <= RIGHT; i++)
        wheelset->x[OMEGA_L + i] = (v + p->initial_creepage * v_r) / rolling_radius(p, i);
}

void wheelset_initialise_tangent(const Wheelset *wheelset, const Inputs *d_u, double d_x[])
{
    const Parameters *p = &wheelset->p;
    double slope;
    regularised_speed(wheelset->u.speed, p->v0, &slope);
    d_x[V] = d_u->speed;
    for (int i = LEFT; i <= RIGHT; i++)
        d_x[OMEGA_L + i] = (1.0 + p->initial_creepage * slope) * d_u->speed / rolling_radius(p, i);
}

int wheelset_moving_states(const Parameters *p, int moving[N_STATES])
{
    int n = 0;
    for (int i = Y; i <= PSI_DOT; i++)
        moving[n++] = i;
    if (p->drive_mode == TORQUE_DRIVEN)
        for (int i = OMEGA_L; i <= THETA; i++)
            moving[n++] = i;
    if (p->forward_dynamics)
        moving[n++] = V;
    return n;
}

static void creepages(const Wheelset *wheelset, const double x[], Evaluation *e)
{
    const Parameters *p = &wheelset->p;
    const Inputs *u = &wheelset->u;
    const double v = e->v, v_r = e->v_r;

    for (int i = LEFT; i <= RIGHT; i++)
        switch (p->drive_mode) {
        case PRESCRIBED_CREEP:
            e->driving[i] = u->prescribed_creepage;
            break;
        case TORQUE_DRIVEN:
            e->driving[i] = (rolling_radius(p, i) * x[OMEGA_L + i] - v) / v_r;
            break;
        default:
            e->driving[i] = 0.0;
        }
    const double turning = p->L_g * (x[PSI_DOT] + v * u->curvature);
    const double rolling = v * p->gamma * (x[Y] - u->track_lateral_offset) / p->r0 + v * unequal_radii(p) / p->r0;
    e->guidance = (turning + rolling) / v_r;

    const double creepage_y = (x[Y_DOT] - v * x[PSI]) / v_r;
    for (int i = LEFT; i <= RIGHT; i++) {
        e->at[i].creepage_x = i == LEFT ? e->driving[i] + e->guidance : e->driving[i] - e->guidance;
        e->at[i].creepage_y = creepage_y;
        e->at[i].speed = v_r;
        e->at[i].normal_load = u->wheel[i].normal_load;
        e->at[i].rail = u->wheel[i].rail;
    }
}

/* Newton and Euler; linear in states, inputs, creep and guiding forces, so derivatives obey them as well. */
static void motion(const Parameters *p, const double x[], const Inputs *u, Evaluation *e)
{
    const Contact *L = &e->contact[LEFT], *R = &e->contact[RIGHT];
    double *x_dot = e->x_dot;
    const int driven = p->drive_mode == TORQUE_DRIVEN;
    const double twist_rate = driven ? x[OMEGA_R] - x[OMEGA_L] : 0.0;
    const double T_s = e->axle_torque = p->k_s * x[THETA] + p->c_s * twist_rate;

    x_dot[Y] = x[Y_DOT];
    x_dot[PSI] = x[PSI_DOT];
    const double F_susp = u->suspension_lateral_force - p->k_y * x[Y] - p->c_y * x[Y_DOT];
    const double M_susp = u->suspension_yaw_moment - p->c_w * x[PSI_DOT];
    x_dot[Y_DOT] = (u->curve_force + F_susp + e->guiding_force - (R->force_y + L->force_y)) / p->m_w;
    x_dot[PSI_DOT] = ((R->force_x - L->force_x) * p->L_g - p->k_w * x[PSI] + M_susp + e->guiding_moment) / p->I_w;
    x_dot[OMEGA_L] = driven ? (T_s - rolling_radius(p, LEFT) * L->force_x) / p->I_L : 0.0;
    x_dot[OMEGA_R] = driven ? (u->traction_torque - T_s - rolling_radius(p, RIGHT) * R->force_x) / p->I_R : 0.0;
    x_dot[THETA] = twist_rate;
    x_dot[V] = p->forward_dynamics ? (R->force_x + L->force_x - u->running_resistance) / p->M_v : 0.0;
}

static void evaluate(const Wheelset *wheelset, const double x[], Evaluation *e,
                     void (*contact)(const ContactPatch *, const ContactState *, Contact *))
{
    const Parameters *p = &wheelset->p;
    e->v = forward_speed(wheelset, x);
    e->v_r = regularised_speed(e->v, p->v0, &e->v_r_slope);
    creepages(wheelset, x, e);
    for (int i = LEFT; i <= RIGHT; i++)
        contact(&p->patch, &e->at[i], &e->contact[i]);
    guiding_evaluate(wheelset, x, e);
    motion(p, x, &wheelset->u, e);
}

void wheelset_derivatives(const Wheelset *wheelset, const double x[], double x_dot[])
{
    Evaluation e;
    evaluate(wheelset, x, &e, contact_force);
    for (int i = 0; i < N_STATES; i++)
        x_dot[i] = e.x_dot[i];
}

void wheelset_evaluate(const Wheelset *wheelset, const double x[], Evaluation *e)
{
    evaluate(wheelset, x, e, contact_evaluate);
}

static double load_carried(const ContactState *at)
{
    return fmax(at->normal_load, 0.0);
}

void wheelset_outputs(const Wheelset *wheelset, const double x[], const Evaluation *e, Outputs *outputs)
{
    const Parameters *p = &wheelset->p;
    outputs->forward_speed = e->v;
    outputs->relative_displacement = x[Y] - wheelset->u.track_lateral_offset;
    outputs->axle_torque = e->axle_torque;
    outputs->flange_force = e->flange.force;

    const double load = load_carried(&e->at[LEFT]) + load_carried(&e->at[RIGHT]);
    const double force = e->contact[LEFT].force_x + e->contact[RIGHT].force_x;
    outputs->adhesion_used = load > 0.0 ? force / load : 0.0;

    for (int i = LEFT; i <= RIGHT; i++) {
        const ContactState *at = &e->at[i];
        const Contact *contact = &e->contact[i];
        WheelOutputs *wheel = &outputs->wheel[i];
        wheel->wheel_speed = p->drive_mode == TORQUE_DRIVEN ? x[OMEGA_L + i]
                                                            : (e->v + e->driving[i] * e->v_r) / p->r0;
        wheel->creepage_x = at->creepage_x;
        wheel->creepage_y = at->creepage_y;
        wheel->creep_force_x = contact->force_x;
        wheel->creep_force_y = contact->force_y;
        wheel->adhesion_used = at->normal_load > 0.0 ? contact->secant * contact->creep / at->normal_load : 0.0;
        wheel->g11 = contact->tangent;
        wheel->g22 = contact->secant;
    }
}

static void creepages_tangent(const Wheelset *wheelset, const double x[], const Evaluation *e,
                              const double d_x[], const Inputs *d_u, Evaluation *d)
{
    const Parameters *p = &wheelset->p;
    const double v = e->v, v_r = e->v_r, d_v = d->v, d_v_r = d->v_r;
    const Inputs *u = &wheelset->u;
    const double relative = x[Y] - u->track_lateral_offset;
    const double d_relative = d_x[Y] - d_u->track_lateral_offset;

    for (int i = LEFT; i <= RIGHT; i++)
        switch (p->drive_mode) {
        case PRESCRIBED_CREEP:
            d->driving[i] = d_u->prescribed_creepage;
            break;
        case TORQUE_DRIVEN:
            d->driving[i] = (rolling_radius(p, i) * d_x[OMEGA_L + i] - d_v - e->driving[i] * d_v_r) / v_r;
            break;
        default:
            d->driving[i] = 0.0;
        }
    const double d_turning = p->L_g * (d_x[PSI_DOT] + d_v * u->curvature + v * d_u->curvature);
    const double d_rolling = (d_v * relative + v * d_relative) * p->gamma / p->r0 + d_v * unequal_radii(p) / p->r0;
    d->guidance = (d_turning + d_rolling - e->guidance * d_v_r) / v_r;

    const double d_creepage_y = (d_x[Y_DOT] - d_v * x[PSI] - v * d_x[PSI] - e->at[LEFT].creepage_y * d_v_r) / v_r;
    for (int i = LEFT; i <= RIGHT; i++) {
        d->at[i].creepage_x = i == LEFT ? d->driving[i] + d->guidance : d->driving[i] - d->guidance;
        d->at[i].creepage_y = d_creepage_y;
        d->at[i].speed = d_v_r;
        d->at[i].normal_load = d_u->wheel[i].normal_load;
        d->at[i].rail = d_u->wheel[i].rail;
    }
}

void wheelset_tangent(const Wheelset *wheelset, const double x[], const Evaluation *e,
                      const double d_x[], const Inputs *d_u, Evaluation *d)
{
    d->v = wheelset->p.forward_dynamics ? d_x[V] : d_u->speed;
    d->v_r = e->v_r_slope * d->v;
    creepages_tangent(wheelset, x, e, d_x, d_u, d);
    for (int i = LEFT; i <= RIGHT; i++)
        contact_force_tangent(&e->contact[i], &e->at[i], &d->at[i], &d->contact[i].force_x, &d->contact[i].force_y);
    guiding_tangent(wheelset, x, e, d_x, d_u, d);
    motion(&wheelset->p, d_x, d_u, d);
}

/* d(|f|/N); at zero force the direction of the change is that of the force. */
static double resultant_tangent(const Contact *contact, const ContactState *at,
                                const Contact *d_contact, const ContactState *d_at)
{
    if (!(at->normal_load > 0.0))
        return 0.0;
    const double force = contact->secant * contact->creep;
    if (!(force > 0.0))
        return portable_length(d_contact->force_x, d_contact->force_y) / at->normal_load;
    const double d_force = (contact->force_x * d_contact->force_x + contact->force_y * d_contact->force_y) / force;
    return (d_force - force / at->normal_load * d_at->normal_load) / at->normal_load;
}

void wheelset_outputs_tangent(const Wheelset *wheelset, const Evaluation *e,
                              const double d_x[], const Inputs *d_u, const Evaluation *d, Outputs *d_outputs)
{
    const Parameters *p = &wheelset->p;
    d_outputs->forward_speed = d->v;
    d_outputs->relative_displacement = d_x[Y] - d_u->track_lateral_offset;
    d_outputs->axle_torque = d->axle_torque;
    d_outputs->flange_force = d->flange.force;

    double load = 0.0, d_load = 0.0;
    for (int i = LEFT; i <= RIGHT; i++)
        if (e->at[i].normal_load > 0.0) {
            load += e->at[i].normal_load;
            d_load += d->at[i].normal_load;
        }
    const double used = load > 0.0 ? (e->contact[LEFT].force_x + e->contact[RIGHT].force_x) / load : 0.0;
    const double d_force = d->contact[LEFT].force_x + d->contact[RIGHT].force_x;
    d_outputs->adhesion_used = load > 0.0 ? (d_force - used * d_load) / load : 0.0;

    for (int i = LEFT; i <= RIGHT; i++) {
        const ContactState *at = &e->at[i], *d_at = &d->at[i];
        const Contact *contact = &e->contact[i], *d_contact = &d->contact[i];
        WheelOutputs *wheel = &d_outputs->wheel[i];
        wheel->wheel_speed = p->drive_mode == TORQUE_DRIVEN ? d_x[OMEGA_L + i]
                             : (d->v + d->driving[i] * e->v_r + e->driving[i] * d->v_r) / p->r0;
        wheel->creepage_x = d_at->creepage_x;
        wheel->creepage_y = d_at->creepage_y;
        wheel->creep_force_x = d_contact->force_x;
        wheel->creep_force_y = d_contact->force_y;
        wheel->adhesion_used = resultant_tangent(contact, at, d_contact, d_at);
        contact_slope_tangent(&p->patch, at, d_at, &wheel->g22, &wheel->g11);
    }
}

void wheelset_jacobian(const Wheelset *wheelset, const double x[], const Evaluation *e, double J[][N_STATES])
{
    static const Inputs HELD = {0};
    int moving[N_STATES];
    const int n = wheelset_moving_states(&wheelset->p, moving);
    for (int column = 0; column < n; column++) {
        const int j = moving[column];
        double d_x[N_STATES] = {0};
        Evaluation d;
        d_x[j] = 1.0;
        wheelset_tangent(wheelset, x, e, d_x, &HELD, &d);
        for (int i = 0; i < N_STATES; i++)
            J[i][j] = d.x_dot[i];
    }
}
