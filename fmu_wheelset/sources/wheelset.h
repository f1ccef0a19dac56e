/* The equations of motion of a solid-axle wheelset, its outputs and their exact derivatives.
 *
 * Structs of values also carry seeds and directional derivatives: prefix `d_` marks a direction. */
#ifndef WHEELSET_H
#define WHEELSET_H

#include "contact.h"

#include <stdint.h>

enum { LEFT, RIGHT };
enum { Y, PSI, Y_DOT, PSI_DOT, OMEGA_L, OMEGA_R, THETA, V, N_STATES };
enum { PRESCRIBED_CREEP = 1, FREE_ROLLING, TORQUE_DRIVEN };

typedef struct {
    double m_w, I_w;           /* mass and yaw inertia of the wheelset */
    double r0, gamma, L_g;     /* rolling radius, conicity, half gauge */
    double k_w;                /* yaw stiffness to the frame */
    double I_L, I_R, k_s, c_s; /* spin inertias of the wheels, torsion of the axle */
    double M_v;                /* vehicle mass carried */
    double delta_r;            /* rolling radius of the left wheel less that of the right */
    double k_y, c_y, c_w;      /* suspension: lateral stiffness and damping, yaw damping */
    double contact_angle;      /* of both wheels at the central position ... */
    double contact_angle_rate; /* ... and what the left gains and the right loses by a displacement */
    double flange_stiffness;   /* 0: no flanges */
    double flange_clearance, flange_transition, flange_damping;
    double g;                  /* gravitational acceleration */
    ContactPatch patch;
    double v0;                 /* speed below which creepages are regularised */
    double initial_creepage;   /* longitudinal, of torque driven wheels */
    int32_t drive_mode;
    int32_t forward_dynamics;  /* the speed is a state instead of an input */
} Parameters;

typedef struct {
    double normal_load;
    RailCondition rail;
} WheelInputs;

typedef struct {
    double speed;
    double prescribed_creepage;
    double traction_torque; /* on the right wheel */
    double suspension_lateral_force, suspension_yaw_moment;
    double curve_force;
    double curvature; /* of the track, positive to the left */
    double cant;      /* right rail above left */
    double running_resistance;
    double track_lateral_offset;
    WheelInputs wheel[2];
} Inputs;

typedef struct {
    Parameters p;
    Inputs u;
    double x[N_STATES];
} Wheelset;

typedef struct {
    double force;             /* lateral, on the wheelset */
    double by_y, by_y_dot;    /* its derivatives by displacement from the track and lateral velocity */
} Flange;

typedef struct {
    double v, v_r, v_r_slope;      /* speed, regularised speed and d(v_r)/dv */
    double driving[2];             /* longitudinal creepage without guidance */
    double guidance;               /* creepage by yawing and conicity, left; right has the opposite sign */
    double axle_torque;
    Flange flange;
    double guiding_force, guiding_moment; /* of flange, gravity and curve */
    ContactState at[2];
    Contact contact[2];
    double x_dot[N_STATES];
} Evaluation;

typedef struct {
    double wheel_speed;
    double creepage_x, creepage_y;
    double creep_force_x, creep_force_y;
    double adhesion_used;
    double g11, g22; /* tangent and secant of the creep force */
} WheelOutputs;

typedef struct {
    double forward_speed;
    double relative_displacement;
    double axle_torque;
    double adhesion_used;
    double flange_force;
    WheelOutputs wheel[2];
} Outputs;

/* Start value of the states that follow from inputs and parameters: wheel speeds and forward speed. */
void wheelset_initialise(Wheelset *wheelset);
void wheelset_initialise_tangent(const Wheelset *wheelset, const Inputs *d_u, double d_x[]);

/* Which states move in the present drive mode; the others have zero derivative. Returns their number. */
int wheelset_moving_states(const Parameters *p, int moving[N_STATES]);

/* At the states `x`; the states inside `wheelset` are not read. */
void wheelset_derivatives(const Wheelset *wheelset, const double x[], double x_dot[]);
void wheelset_evaluate(const Wheelset *wheelset, const double x[], Evaluation *e);
void wheelset_outputs(const Wheelset *wheelset, const double x[], const Evaluation *e, Outputs *outputs);

/* Directional derivatives along d_x and d_u. `d` receives those of what `e` holds, of `contact` the forces;
 * wheelset_outputs_tangent reads it. */
void wheelset_tangent(const Wheelset *wheelset, const double x[], const Evaluation *e,
                      const double d_x[], const Inputs *d_u, Evaluation *d);
void wheelset_outputs_tangent(const Wheelset *wheelset, const Evaluation *e,
                              const double d_x[], const Inputs *d_u, const Evaluation *d, Outputs *d_outputs);

/* J[i][j] = d(x_dot_i)/d(x_j) in the columns of the moving states. */
void wheelset_jacobian(const Wheelset *wheelset, const double x[], const Evaluation *e, double J[][N_STATES]);

#endif
