/* A bank of steady-state Kalman filters as one writes it by hand, for benchmarks/filter_bank.py.
 *
 * Row-major arrays: F (n, s, s), H (n, m, s), K (n, s, m), z (T, m), x (n, s) predictions, e (T, n, m).
 * The second function also whitens by L^-1 (n, m, m) and adds w'w + log det S over blocks of samples:
 * loss (T / every, n). */

#include <stddef.h>

enum { MAX_STATES = 16, MAX_SENSORS = 4 };

static void advance(const double *F, const double *H, const double *K, const double *z, size_t s, size_t m,
                    double *x, double *e)
{
    double updated[MAX_STATES];
    for (size_t a = 0; a < m; a++) {
        e[a] = z[a];
        for (size_t k = 0; k < s; k++) e[a] -= H[a * s + k] * x[k];
    }
    for (size_t j = 0; j < s; j++) {
        updated[j] = x[j];
        for (size_t a = 0; a < m; a++) updated[j] += K[j * m + a] * e[a];
    }
    for (size_t j = 0; j < s; j++) {
        double total = 0.0;
        for (size_t k = 0; k < s; k++) total += F[j * s + k] * updated[k];
        x[j] = total;
    }
}

void innovations(const double *F, const double *H, const double *K, const double *z, size_t T, size_t n,
                 size_t s, size_t m, double *x, double *e)
{
    for (size_t t = 0; t < T; t++)
        for (size_t i = 0; i < n; i++)
            advance(F + i * s * s, H + i * m * s, K + i * s * m, z + t * m, s, m, x + i * s,
                    e + (t * n + i) * m);
}

void likelihoods(const double *F, const double *H, const double *K, const double *whitener,
                 const double *log_det, const double *z, size_t T, size_t n, size_t s, size_t m, size_t every,
                 double *x, double *loss)
{
    double e[MAX_SENSORS];
    for (size_t t = 0; t < T - T % every; t++) {
        double *row = loss + t / every * n;
        for (size_t i = 0; i < n; i++) {
            double squares = 0.0;
            advance(F + i * s * s, H + i * m * s, K + i * s * m, z + t * m, s, m, x + i * s, e);
            for (size_t a = 0; a < m; a++) {
                double white = 0.0;
                for (size_t b = 0; b <= a; b++) white += whitener[(i * m + a) * m + b] * e[b];
                squares += white * white;
            }
            row[i] = (t % every ? row[i] : 0.0) + squares + log_det[i];
        }
    }
}
