#include "integrator.h"

#include <float.h>
#include <math.h>
#include <string.h>

/* Rodas5P of G. Steinebach, "Construction of Rosenbrock-Wanner method Rodas5P", BIT Numerical Mathematics 63
 * (2023) 27: order 5 with 8 stages and an embedded solution of order 4, both stiffly accurate and L-stable. The
 * form is that of RODAS (E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, section IV.7). The
 * arguments of the last two stages are that of the stage before plus its k. */
enum { STAGES = 8, WITH_COEFFICIENTS = 6, N = INTEGRATOR_MAX_STATES };
static const double GAMMA = 0.21193756319429014;
static const double A[WITH_COEFFICIENTS][WITH_COEFFICIENTS - 1] = {
    {0.0},
    {3.0},
    {2.849394379747939, 0.45842242204463923},
    {-6.954028509809101, 2.489845061869568, -10.358996098473584},
    {2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641},
    {-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946},
};
static const double C[STAGES][STAGES - 1] = {
    {0.0},
    {-14.155112264123755},
    {-17.97296035885952, -2.859693295451294},
    {147.12150275711716, -1.41221402718213, 71.68940251302358},
    {165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306},
    {24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471},
    {30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
     -28.087943162872662},
    {37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
     -54.66780262877968, -9.48861652309627},
};

/* A vector over the moving states, filled up with zeros: loops of fixed length run in vector registers. */
typedef double Vector[N];

/* x_dot and its Jacobian at the start of a step, over all states. */
typedef struct {
    Vector x_dot;
    double J[N][N];
} Linearisation;

static void add_scaled(Vector sum, double factor, const Vector v)
{
    for (int i = 0; i < N; i++)
        sum[i] += factor * v[i];
}

static void swap(double *a, double *b)
{
    const double swapped = *a;
    *a = *b;
    *b = swapped;
}

/* The row of the largest element on or below the diagonal; -1 if the column is zero or not finite there. */
static int find_pivot(const Vector column, int n, int k)
{
    int p = k;
    for (int i = k + 1; i < n; i++)
        if (fabs(column[i]) > fabs(column[p]))
            p = i;
    return fabs(column[p]) > 0.0 && fabs(column[p]) <= DBL_MAX ? p : -1;
}

/* Gauss-Jordan with partial pivoting, in place; M[j] is column j. The stages then only multiply, which has no
 * chain of dependent operations as the substitution in triangular factors has: faster for so small a matrix
 * with eight right-hand sides. Returns 0 if M is singular or not finite. */
static int invert(Vector M[], int n)
{
    int pivot[N];
    for (int k = 0; k < n; k++) {
        const int p = pivot[k] = find_pivot(M[k], n, k);
        if (p < 0)
            return 0;
        if (p != k)
            for (int j = 0; j < n; j++)
                swap(&M[j][k], &M[j][p]);
        const double inverse = 1.0 / M[k][k];
        Vector eliminated;
        memcpy(eliminated, M[k], sizeof eliminated);
        eliminated[k] = 0.0;
        memset(M[k], 0, sizeof eliminated);
        M[k][k] = 1.0;
        for (int j = 0; j < n; j++) {
            const double row = M[j][k] * inverse;
            add_scaled(M[j], -row, eliminated);
            M[j][k] = row;
        }
    }
    for (int k = n - 1; k >= 0; k--)
        for (int i = 0; i < n && pivot[k] != k; i++)
            swap(&M[k][i], &M[pivot[k]][i]);
    return 1;
}

/* The inverse of I/(gamma h) - J over the moving states. */
static int stage_matrix(const OdeSystem *system, const Linearisation *at, double h, Vector inverse[])
{
    const int n = system->n_moving;
    memset(inverse, 0, N * sizeof(Vector));
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < n; i++)
            inverse[j][i] = -at->J[system->moving[i]][system->moving[j]];
        inverse[j][j] += 1.0 / (GAMMA * h);
    }
    return invert(inverse, n);
}

/* Stage s solves (I/(gamma h) - J) k_s = f(x + sum_j a_sj k_j) + sum_j (c_sj/h) k_j. The argument of the last
 * stage is the embedded solution, and its k the difference to the solution of order 5. */
static int rodas_step(const OdeSystem *system, const double x[], const Linearisation *at, double h,
                      double x_next[], double error[])
{
    const int n = system->n_moving;
    const double rate = 1.0 / h;
    Vector inverse[N], k[STAGES], x_dot, shift = {0.0};
    if (!stage_matrix(system, at, h, inverse))
        return 0;

    for (int i = 0; i < system->n_states; i++)
        x_next[i] = x[i];
    for (int s = 0; s < STAGES; s++) {
        Vector right = {0.0};
        if (s < WITH_COEFFICIENTS)
            memset(shift, 0, sizeof shift);
        for (int j = 0; j < s; j++) {
            if (s < WITH_COEFFICIENTS)
                add_scaled(shift, A[s][j], k[j]);
            add_scaled(right, C[s][j] * rate, k[j]);
        }
        if (s >= WITH_COEFFICIENTS)
            add_scaled(shift, 1.0, k[s - 1]);
        for (int i = 0; i < n; i++)
            x_next[system->moving[i]] = x[system->moving[i]] + shift[i];
        if (s > 0)
            system->evaluate(system->model, x_next, x_dot, 0);
        for (int i = 0; i < n; i++)
            right[i] += (s > 0 ? x_dot : at->x_dot)[system->moving[i]];
        memset(k[s], 0, sizeof k[s]);
        for (int j = 0; j < n; j++)
            add_scaled(k[s], right[j], inverse[j]);
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

/* norm^(3/16): just below the 1/5 of an error of order h^5, and of square roots, which all machines round alike. */
static double root_of(double norm)
{
    const double eighth = sqrt(sqrt(sqrt(fmax(norm, DBL_MIN))));
    return eighth * sqrt(eighth);
}

IntegrationResult integrator_advance(const OdeSystem *system, double x[], double duration, StepSizes *sizes)
{
    enum { MAX_STEPS = 100000 };
    static const double SMALLEST = 1e-12, SAFETY = 0.9, SHRINK = 0.1, GROW = 5.0;
    double start[N], next[N], error[N];
    const int jumped = !(sizes->next > 0.0);
    double after_jump = sizes->after_jump, elapsed = 0.0, limit = GROW;
    double proposal = !jumped ? sizes->next : after_jump > 0.0 ? after_jump : duration;
    Linearisation at;

    for (int i = 0; i < system->n_states; i++)
        start[i] = x[i];
    system->evaluate(system->model, x, at.x_dot, at.J);
    IntegrationResult result = INTEGRATION_TOO_MANY_STEPS;
    for (int step = 0; step < MAX_STEPS; step++) {
        const double rest = duration - elapsed;
        const double pieces = ceil(rest / proposal);
        const double h = pieces > 2.0 ? proposal : rest / pieces; /* two equal pieces leave no tiny last step */
        if (!(h > SMALLEST * duration)) {
            result = INTEGRATION_STEP_TOO_SMALL;
            break;
        }
        const int defined = rodas_step(system, x, &at, h, next, error);
        const double norm = defined ? error_norm(system, x, next, error) : INFINITY;
        const double factor = isfinite(norm) ? SAFETY / root_of(norm) : 0.0;
        if (!(norm <= 1.0)) {
            proposal = h * fmax(SHRINK, fmin(factor, SAFETY));
            limit = 1.0;
            continue;
        }
        proposal = h * fmin(limit, factor);
        limit = GROW;
        if (jumped && elapsed == 0.0)
            after_jump = proposal;
        elapsed += h;
        for (int i = 0; i < system->n_states; i++)
            x[i] = next[i];
        if (pieces <= 1.0) {
            sizes->next = proposal;
            sizes->after_jump = after_jump;
            return INTEGRATION_DONE;
        }
        system->evaluate(system->model, x, at.x_dot, at.J);
    }
    for (int i = 0; i < system->n_states; i++)
        x[i] = start[i];
    return result;
}
