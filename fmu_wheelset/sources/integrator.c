#include "integrator.h"

#include <float.h>
#include <math.h>

/* RODAS of E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, section IV.7: a Rosenbrock
 * method of order 4 with 6 stages and an embedded solution of order 3, both stiffly accurate and L-stable. */
enum { STAGES = 6 };
static const double GAMMA = 0.25;
static const double A[STAGES][STAGES - 1] = {
    {0.0},
    {1.544},
    {0.9466785280815826, 0.2557011698983284},
    {3.314825187068521, 2.896124015972201, 0.9986419139977817},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0},
};
static const double C[STAGES][STAGES - 1] = {
    {0.0},
    {-5.6688},
    {-2.430093356833875, -0.2063599157091915},
    {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
    {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160},
    {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054},
};

/* LU factors, stored by columns so that the inner loops have no chain of sums. */
typedef struct {
    int n;
    int pivot[INTEGRATOR_MAX_STATES];
    double lu[INTEGRATOR_MAX_STATES][INTEGRATOR_MAX_STATES];
    double inverse_diagonal[INTEGRATOR_MAX_STATES];
} Factors;

/* x_dot and its Jacobian at the start of a step. */
typedef struct {
    double x_dot[INTEGRATOR_MAX_STATES];
    double J[INTEGRATOR_MAX_STATES][INTEGRATOR_MAX_STATES];
} Linearisation;

static void swap(double *a, double *b)
{
    const double swapped = *a;
    *a = *b;
    *b = swapped;
}

/* LU with partial pivoting of I/(gamma h) - J over the moving states. Returns 0 if singular or not finite. */
static int factorise(const OdeSystem *system, const Linearisation *at, double h, Factors *f)
{
    const int n = f->n = system->n_moving;
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < n; i++)
            f->lu[j][i] = -at->J[system->moving[i]][system->moving[j]];
        f->lu[j][j] += 1.0 / (GAMMA * h);
    }
    for (int k = 0; k < n; k++) {
        double *column = f->lu[k];
        int p = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(column[i]) > fabs(column[p]))
                p = i;
        if (!(fabs(column[p]) > 0.0 && fabs(column[p]) <= DBL_MAX))
            return 0;
        f->pivot[k] = p;
        if (p != k)
            for (int j = 0; j < n; j++)
                swap(&f->lu[j][k], &f->lu[j][p]);
        f->inverse_diagonal[k] = 1.0 / column[k];
        for (int i = k + 1; i < n; i++)
            column[i] *= f->inverse_diagonal[k];
        for (int j = k + 1; j < n; j++)
            for (int i = k + 1; i < n; i++)
                f->lu[j][i] -= column[i] * f->lu[j][k];
    }
    return 1;
}

static void solve(const Factors *f, double b[])
{
    for (int j = 0; j < f->n; j++)
        swap(&b[j], &b[f->pivot[j]]);
    for (int j = 0; j < f->n; j++)
        for (int i = j + 1; i < f->n; i++)
            b[i] -= f->lu[j][i] * b[j];
    for (int j = f->n - 1; j >= 0; j--) {
        b[j] *= f->inverse_diagonal[j];
        for (int i = 0; i < j; i++)
            b[i] -= f->lu[j][i] * b[j];
    }
}

/* Stage s solves (I/(gamma h) - J) k_s = f(x + sum_j a_sj k_j) + sum_j (c_sj/h) k_j. The argument of the last
 * stage is the embedded solution, and k_6 the difference to the solution of order 4. */
static int rodas_step(const OdeSystem *system, const double x[], const Linearisation *at, double h,
                      double x_next[], double error[])
{
    const int n = system->n_moving;
    Factors factors;
    double k[STAGES][INTEGRATOR_MAX_STATES], x_dot[INTEGRATOR_MAX_STATES];
    if (!factorise(system, at, h, &factors))
        return 0;

    for (int i = 0; i < system->n_states; i++)
        x_next[i] = x[i];
    for (int s = 0; s < STAGES; s++) {
        double shift[INTEGRATOR_MAX_STATES] = {0.0}, coupling[INTEGRATOR_MAX_STATES] = {0.0};
        for (int j = 0; j < s; j++) {
            const double a = A[s][j], c = C[s][j] / h;
            for (int i = 0; i < n; i++) {
                shift[i] += a * k[j][i];
                coupling[i] += c * k[j][i];
            }
        }
        for (int i = 0; i < n; i++)
            x_next[system->moving[i]] = x[system->moving[i]] + shift[i];
        if (s > 0)
            system->evaluate(system->model, x_next, x_dot, 0);
        for (int i = 0; i < n; i++)
            k[s][i] = (s > 0 ? x_dot : at->x_dot)[system->moving[i]] + coupling[i];
        solve(&factors, k[s]);
    }
    for (int i = 0; i < n; i++) {
        x_next[system->moving[i]] += k[STAGES - 1][i];
        error[i] = k[STAGES - 1][i];
    }
    return 1;
}

int integrator_step(const OdeSystem *system, const double x[], double h, double x_next[], double error[])
{
    Linearisation at;
    system->evaluate(system->model, x, at.x_dot, at.J);
    return rodas_step(system, x, &at, h, x_next, error);
}

/* Root mean square of the error in units of the tolerance; not finite if a state is not. */
static double error_norm(const OdeSystem *system, const double x[], const double x_next[], const double error[])
{
    double sum = 0.0;
    for (int i = 0; i < system->n_moving; i++) {
        const int j = system->moving[i];
        const double size = fmax(fabs(x[j]), fabs(x_next[j])) + system->nominal[j];
        const double ratio = error[i] / (system->tolerance * size);
        sum += isfinite(x_next[j]) ? ratio * ratio : INFINITY;
    }
    return sqrt(sum / system->n_moving);
}

IntegrationResult integrator_advance(const OdeSystem *system, double x[], double duration, double *step_size)
{
    enum { MAX_STEPS = 100000 };
    static const double SMALLEST = 1e-12, SAFETY = 0.9, SHRINK = 0.1, GROW = 5.0;
    double start[INTEGRATOR_MAX_STATES], next[INTEGRATOR_MAX_STATES], error[INTEGRATOR_MAX_STATES];
    double proposal = *step_size > 0.0 ? *step_size : duration, elapsed = 0.0, limit = GROW;
    Linearisation at;

    for (int i = 0; i < system->n_states; i++)
        start[i] = x[i];
    system->evaluate(system->model, x, at.x_dot, at.J);
    IntegrationResult result = INTEGRATION_TOO_MANY_STEPS;
    for (int step = 0; step < MAX_STEPS; step++) {
        const double rest = duration - elapsed;
        const double pieces = ceil(rest / proposal);
        const double h = rest / pieces; /* equal pieces leave no tiny last step */
        if (!(h > SMALLEST * duration)) {
            result = INTEGRATION_STEP_TOO_SMALL;
            break;
        }
        const int defined = rodas_step(system, x, &at, h, next, error);
        const double norm = defined ? error_norm(system, x, next, error) : INFINITY;
        const double factor = isfinite(norm) ? SAFETY / sqrt(sqrt(fmax(norm, DBL_MIN))) : 0.0;
        if (!(norm <= 1.0)) {
            proposal = h * fmax(SHRINK, fmin(factor, SAFETY));
            limit = 1.0;
            continue;
        }
        proposal = h * fmin(limit, factor);
        limit = GROW;
        elapsed += h;
        for (int i = 0; i < system->n_states; i++)
            x[i] = next[i];
        if (pieces <= 1.0) {
            *step_size = proposal;
            return INTEGRATION_DONE;
        }
        system->evaluate(system->model, x, at.x_dot, at.J);
    }
    for (int i = 0; i < system->n_states; i++)
        x[i] = start[i];
    return result;
}
