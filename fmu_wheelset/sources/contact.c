#include "contact.h"

#include "elementary.h"

#include <float.h>
#include <math.h>

/* With P = G a b/2, c = c_jj and the friction mu = mu_0 r(w) at the slip speed w = lambda*speed,
 *
 *     F/lambda = P c q,    q = k_A/(1 + (k_A eps)^2) + k_S atan(k_S eps)/(k_S eps),
 *     eps = (pi/2) P c lambda/(N mu)
 *
 * which is the law as published with the 0/0 at rest divided out. Products of eps are written with
 * logarithmic derivatives: m = dq/d(ln eps), and h = -d(ln mu)/dw. */

static const double HALF_PI = 1.57079632679489661923;

typedef struct {
    double creep;        /* lambda */
    double nx, ny;       /* its direction */
    double c, P;         /* c_jj and G a b/2 */
    double w, e, r;      /* slip speed, exp(-B w), mu/mu_0 */
    double rA, sA;       /* 1/(1 + x) and x/(1 + x) with x = (k_A eps)^2 */
    double rS, sS;       /* the same with k_S */
    double atanc, slope; /* atan(z)/z with z = k_S eps, and its logarithmic derivative */
    double q;
} Law;

/* 1/(1 + x) and x/(1 + x) for x >= 0, also where x is tiny or overflows. */
static void saturation(double x, double *rest, double *share)
{
    *rest = 1.0 / (1.0 + x);
    *share = x < 1.0 ? x * *rest : 1.0 - *rest;
}

/* atan(z)/z and z d/dz of it, which is 1/(1 + z^2) - atan(z)/z, without cancellation near 0. */
static void atan_over(double z, double rational, double *value, double *slope)
{
    const double z2 = z * z;
    if (z2 < 2.5e-3) {
        *slope = -z2 * (2.0 / 3.0 - z2 * (4.0 / 5.0 - z2 * (6.0 / 7.0
                 - z2 * (8.0 / 9.0 - z2 * (10.0 / 11.0 - z2 * (12.0 / 13.0))))));
        *value = rational - *slope;
    } else {
        *value = portable_atan(z) / z;
        *slope = rational - *value;
    }
}

static void direction(const ContactPatch *patch, const ContactState *at, Law *law)
{
    const double square = at->creepage_x * at->creepage_x + at->creepage_y * at->creepage_y;
    law->creep = square > DBL_MIN ? sqrt(square) : 0.0;
    law->nx = law->creep > 0.0 ? at->creepage_x / law->creep : 1.0;
    law->ny = law->creep > 0.0 ? at->creepage_y / law->creep : 0.0;
    const double cx = patch->C11 * law->nx, cy = patch->C22 * law->ny;
    law->c = sqrt(cx * cx + cy * cy);
}

static void evaluate(const ContactPatch *patch, const ContactState *at, Law *law)
{
    const RailCondition *rail = &at->rail;
    direction(patch, at, law);
    law->P = 0.5 * patch->G * patch->a * patch->b;
    law->w = law->creep * at->speed;
    law->e = portable_exp(-rail->B * law->w);
    law->r = (1.0 - rail->A) * law->e + rail->A;

    const double eps = HALF_PI * law->P * law->c * law->creep / (at->normal_load * rail->mu_0 * law->r);
    const double adhesion = rail->k_A * eps, slip = rail->k_S * eps;
    saturation(adhesion * adhesion, &law->rA, &law->sA);
    saturation(slip * slip, &law->rS, &law->sS);
    atan_over(slip, law->rS, &law->atanc, &law->slope);
    law->q = rail->k_A * law->rA + rail->k_S * law->atanc;
}

/* m = dq/d(ln eps) */
static double log_derivative(const RailCondition *rail, const Law *law)
{
    return -2.0 * rail->k_A * law->sA * law->rA + rail->k_S * law->slope;
}

/* h = -d(ln mu)/dw */
static double friction_decay(const RailCondition *rail, const Law *law)
{
    return (1.0 - rail->A) * rail->B * law->e / law->r;
}

static double secant(const Law *law)
{
    return law->P * law->c * law->q;
}

/* dF/dlambda in a fixed direction. */
static double tangent(const RailCondition *rail, const Law *law)
{
    const double m = log_derivative(rail, law), h = friction_decay(rail, law);
    return law->P * law->c * (law->q + m * (1.0 + law->w * h));
}

/* J = d(force)/d(creepage). At rest c_jj depends on the direction and the limit along each axis is taken. */
static void jacobian(const ContactPatch *patch, const Law *law, double m, Contact *contact)
{
    const double C11 = patch->C11, C22 = patch->C22, c = law->c;
    if (law->creep == 0.0) {
        contact->jacobian[0][0] = law->P * C11 * law->q;
        contact->jacobian[1][1] = law->P * C22 * law->q;
        contact->jacobian[0][1] = contact->jacobian[1][0] = 0.0;
        return;
    }
    const double radial = contact->tangent - contact->secant;
    const double by_c = law->P * (law->q + m);
    const double gx = law->nx * (radial + by_c * (C11 * C11 - c * c) / c);
    const double gy = law->ny * (radial + by_c * (C22 * C22 - c * c) / c);
    contact->jacobian[0][0] = contact->secant + law->nx * gx;
    contact->jacobian[0][1] = law->nx * gy;
    contact->jacobian[1][0] = law->ny * gx;
    contact->jacobian[1][1] = contact->secant + law->ny * gy;
}

/* Derivatives of the secant at constant creepage: eps varies with the friction and the normal load. */
static void sensitivities(const ContactState *at, const Law *law, double m, Contact *contact)
{
    const RailCondition *rail = &at->rail;
    const double Pc = law->P * law->c, by_ln_eps = Pc * m;
    RailCondition *by = &contact->secant_by_rail;
    contact->secant_by_speed = by_ln_eps * law->creep * friction_decay(rail, law);
    contact->secant_by_load = -by_ln_eps / at->normal_load;
    by->k_A = Pc * law->rA * (2.0 * law->rA - 1.0);
    by->k_S = Pc * law->rS;
    by->mu_0 = -by_ln_eps / rail->mu_0;
    by->A = -by_ln_eps * (1.0 - law->e) / law->r;
    by->B = by_ln_eps * (1.0 - rail->A) * law->e * law->w / law->r;
}

void contact_force(const ContactPatch *patch, const ContactState *at, Contact *contact)
{
    Law law;
    if (!(at->normal_load > 0.0)) {
        contact->force_x = contact->force_y = 0.0;
        return;
    }
    evaluate(patch, at, &law);
    contact->force_x = secant(&law) * at->creepage_x;
    contact->force_y = secant(&law) * at->creepage_y;
}

void contact_evaluate(const ContactPatch *patch, const ContactState *at, Contact *contact)
{
    static const Contact LIFTED = {0};
    *contact = LIFTED;
    if (!(at->normal_load > 0.0))
        return;

    Law law;
    evaluate(patch, at, &law);
    const double m = log_derivative(&at->rail, &law);
    contact->creep = law.creep;
    contact->secant = secant(&law);
    contact->tangent = tangent(&at->rail, &law);
    contact->force_x = contact->secant * at->creepage_x;
    contact->force_y = contact->secant * at->creepage_y;
    jacobian(patch, &law, m, contact);
    sensitivities(at, &law, m, contact);
}

static double secant_tangent(const Contact *contact, const ContactState *d)
{
    const RailCondition *by = &contact->secant_by_rail;
    return contact->secant_by_speed * d->speed + contact->secant_by_load * d->normal_load
         + by->k_A * d->rail.k_A + by->k_S * d->rail.k_S + by->mu_0 * d->rail.mu_0
         + by->A * d->rail.A + by->B * d->rail.B;
}

void contact_force_tangent(const Contact *contact, const ContactState *at, const ContactState *d,
                           double *d_force_x, double *d_force_y)
{
    const double d_secant = secant_tangent(contact, d);
    const double (*J)[2] = contact->jacobian;
    *d_force_x = J[0][0] * d->creepage_x + J[0][1] * d->creepage_y + d_secant * at->creepage_x;
    *d_force_y = J[1][0] * d->creepage_x + J[1][1] * d->creepage_y + d_secant * at->creepage_y;
}

void contact_slope_tangent(const ContactPatch *patch, const ContactState *at, const ContactState *d,
                           double *d_secant, double *d_tangent)
{
    *d_secant = *d_tangent = 0.0;
    if (!(at->normal_load > 0.0))
        return;

    Law law;
    evaluate(patch, at, &law);
    const RailCondition *rail = &at->rail, *d_rail = &d->rail;
    const double m = log_derivative(rail, &law), h = friction_decay(rail, &law);

    double d_creep = 0.0, ln_creep = 0.0, ln_c = 0.0; /* ln_x stands for d(ln x) */
    if (law.creep > 0.0) {
        const double cx = patch->C11 / law.c, cy = patch->C22 / law.c;
        d_creep = law.nx * d->creepage_x + law.ny * d->creepage_y;
        ln_creep = d_creep / law.creep;
        ln_c = (cx * cx * law.nx * d->creepage_x + cy * cy * law.ny * d->creepage_y - d_creep) / law.creep;
    }
    const double d_w = d_creep * at->speed + law.creep * d->speed;
    const double d_e = -law.e * (d_rail->B * law.w + rail->B * d_w);
    const double d_r = (1.0 - rail->A) * d_e + d_rail->A * (1.0 - law.e);
    const double d_h = ((1.0 - rail->A) * (d_rail->B * law.e + rail->B * d_e)
                        - d_rail->A * rail->B * law.e - h * d_r) / law.r;
    const double ln_eps = ln_c + ln_creep - d->normal_load / at->normal_load
                        - d_rail->mu_0 / rail->mu_0 - d_r / law.r;

    /* m = -2 k_A m_A + k_S slope, each term with its own logarithmic derivative */
    const double m_A = law.sA * law.rA, d_m_A = 2.0 * m_A * (2.0 * law.rA - 1.0);
    const double d_slope = -2.0 * law.sS * law.rS - law.slope;
    const double d_q = m * ln_eps + law.rA * (2.0 * law.rA - 1.0) * d_rail->k_A + law.rS * d_rail->k_S;
    const double d_m = (-2.0 * rail->k_A * d_m_A + rail->k_S * d_slope) * ln_eps
                     - 2.0 * (m_A + d_m_A) * d_rail->k_A + (law.slope + d_slope) * d_rail->k_S;

    *d_secant = secant(&law) * ln_c + law.P * law.c * d_q;
    *d_tangent = tangent(rail, &law) * ln_c
               + law.P * law.c * (d_q + d_m * (1.0 + law.w * h) + m * (d_w * h + law.w * d_h));
}

/* Force and slope dF/dlambda of pure longitudinal creep. */
static double longitudinal(const ContactPatch *patch, const ContactState *at, double creep, double *slope)
{
    ContactState pure = *at;
    Law law;
    pure.creepage_x = creep;
    pure.creepage_y = 0.0;
    evaluate(patch, &pure, &law);
    *slope = tangent(&pure.rail, &law);
    return secant(&law) * creep;
}

/* The root of the slope between `low`, where the force rises, and `high`: Newton kept inside by bisection. */
static double crest(const ContactPatch *patch, const ContactState *at, double low, double high)
{
    enum { ITERATIONS = 100 };
    static const ContactState BY_CREEP = {.creepage_x = 1.0};
    ContactState pure = *at;
    pure.creepage_y = 0.0;
    double creep = 0.5 * (low + high);
    for (int i = 0; i < ITERATIONS && high - low > 2.0 * DBL_EPSILON * high; i++) {
        double slope, curvature, unused;
        longitudinal(patch, at, creep, &slope);
        pure.creepage_x = creep;
        contact_slope_tangent(patch, &pure, &BY_CREEP, &unused, &curvature);
        if (slope > 0.0)
            low = creep;
        else
            high = creep;
        const double newton = creep - slope / curvature;
        if (fabs(newton - creep) <= DBL_EPSILON * creep)
            break;
        creep = low < newton && newton < high ? newton : 0.5 * (low + high);
    }
    return creep;
}

/* A geometric scan finds the interval that holds the highest peak. */
ContactPeak contact_peak(const ContactPatch *patch, const ContactState *at)
{
    static const double RATIO = 1.5, SMALLEST = 1e-9;
    ContactPeak peak = {0.0, 0.0};
    if (!(at->normal_load > 0.0))
        return peak;

    /* The law is still linear, so the force rises, where k eps = 0.1 with the larger k. */
    const double k = fmax(at->rail.k_A, at->rail.k_S);
    const double stiffness = HALF_PI * 0.5 * patch->G * patch->a * patch->b * patch->C11;
    const double linear = 0.1 * at->rail.A * at->normal_load * at->rail.mu_0 / (k * stiffness);
    double creep = fmax(SMALLEST, fmin(1.0, linear));
    double low = creep, slope, highest = 0.0;
    for (;;) {
        const double force = longitudinal(patch, at, creep, &slope);
        if (force > highest) {
            highest = force;
            low = slope > 0.0 ? creep : creep / RATIO;
        }
        if (creep >= 1.0)
            break;
        creep = fmin(1.0, creep * RATIO);
    }
    peak.creep_peak = low < 1.0 ? crest(patch, at, low, fmin(1.0, low * RATIO)) : 1.0;
    peak.adhesion_peak = longitudinal(patch, at, peak.creep_peak, &slope) / at->normal_load;
    return peak;
}

ContactPeak contact_peak_tangent(const ContactPatch *patch, const ContactState *at,
                                 const ContactPeak *peak, const ContactState *d)
{
    ContactPeak d_peak = {0.0, 0.0};
    if (!(at->normal_load > 0.0))
        return d_peak;

    ContactState pure = *at, others = *d, creep_only = {0};
    pure.creepage_x = peak->creep_peak;
    pure.creepage_y = others.creepage_x = others.creepage_y = 0.0;
    creep_only.creepage_x = 1.0;
    double unused, slope_by_others, curvature, d_force_x, d_force_y;
    contact_slope_tangent(patch, &pure, &others, &unused, &slope_by_others);
    contact_slope_tangent(patch, &pure, &creep_only, &unused, &curvature);
    if (peak->creep_peak < 1.0)
        d_peak.creep_peak = -slope_by_others / curvature;

    /* The slope is zero at the peak, so moving the peak along does not change its height. */
    Contact contact;
    contact_evaluate(patch, &pure, &contact);
    contact_force_tangent(&contact, &pure, &others, &d_force_x, &d_force_y);
    d_peak.adhesion_peak = (d_force_x - peak->adhesion_peak * d->normal_load) / at->normal_load;
    return d_peak;
}
