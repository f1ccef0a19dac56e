/* The creep force of one wheel on its rail (Polach 2005, without spin) and its exact derivatives.
 *
 * Structs of values also carry seeds and directional derivatives: `at` is a point, `d` a direction. */
#ifndef CONTACT_H
#define CONTACT_H

typedef struct {
    double G;        /* shear modulus, Pa */
    double a, b;     /* semi-axes of the contact ellipse along and across the rail, m */
    double C11, C22; /* Kalker coefficients */
} ContactPatch;

typedef struct {
    double k_A, k_S; /* reduction factors in the areas of adhesion and slip */
    double mu_0;     /* friction coefficient at zero slip speed */
    double A;        /* ratio of friction at infinite to zero slip speed */
    double B;        /* decay of friction with slip speed, s/m */
} RailCondition;

typedef struct {
    double creepage_x, creepage_y;
    double speed;       /* slip speed per unit creep (regularised, so never zero), m/s */
    double normal_load; /* N; a wheel without load is lifted and carries no creep force */
    RailCondition rail;
} ContactState;

typedef struct {
    double force_x, force_y;  /* N */
    double creep;             /* lambda */
    double secant;            /* F/lambda, N */
    double tangent;           /* dF/dlambda in the direction of the creepage, N */
    double jacobian[2][2];    /* d(force_x, force_y)/d(creepage_x, creepage_y), N */
    double secant_by_speed;   /* derivatives of the secant at constant creepage */
    double secant_by_load;
    RailCondition secant_by_rail;
} Contact;

typedef struct {
    double creep_peak;    /* where the longitudinal creep force is largest, at most 1 */
    double adhesion_peak; /* that force over the normal load */
} ContactPeak;

/* Only the forces, at half the cost. */
void contact_force(const ContactPatch *patch, const ContactState *at, Contact *contact);

void contact_evaluate(const ContactPatch *patch, const ContactState *at, Contact *contact);

/* Directional derivative of the creep force; `contact` holds the evaluation at `at`. */
void contact_force_tangent(const Contact *contact, const ContactState *at, const ContactState *d,
                           double *d_force_x, double *d_force_y);

/* Directional derivatives of secant and tangent: second derivatives of the force. */
void contact_slope_tangent(const ContactPatch *patch, const ContactState *at, const ContactState *d,
                           double *d_secant, double *d_tangent);

/* The peak of pure longitudinal creep; the creepages in `at` do not matter. */
ContactPeak contact_peak(const ContactPatch *patch, const ContactState *at);
ContactPeak contact_peak_tangent(const ContactPatch *patch, const ContactState *at,
                                 const ContactPeak *peak, const ContactState *d);

#endif
