#include "elementary.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

static uint64_t bits_of(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static double from_bits(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* 2^k where it is a normal number: a biased exponent over an empty fraction. */
static double power_of_two(int k)
{
    return from_bits((uint64_t)(k + 1023) << 52);
}

/* exp(x) = 2^k exp(r) with |r| <= ln(2)/2, and exp(r) by its Taylor polynomial of degree 13. ln(2) in two parts:
 * k times the first is exact. The sums are grouped in pairs, which shortens the chain of dependent operations. */
double portable_exp(double x)
{
    static const double LN2 = 0.6931471803691238, LN2_REST = 1.9082149292705877e-10, LOG2_E = 1.4426950408889634;
    static const double C[] = {1.0 / 2.0,       1.0 / 6.0,        1.0 / 24.0,        1.0 / 120.0,
                               1.0 / 720.0,     1.0 / 5040.0,     1.0 / 40320.0,     1.0 / 362880.0,
                               1.0 / 3628800.0, 1.0 / 39916800.0, 1.0 / 479001600.0, 1.0 / 6227020800.0};
    if (!(x >= -746.0 && x <= 710.0)) /* nothing, everything, or not a number */
        return x < 0.0 ? 0.0 : x > 0.0 ? INFINITY : x;

    const int k = (int)(x * LOG2_E + (x < 0.0 ? -0.5 : 0.5));
    const double whole = x - k * LN2, rest = k * LN2_REST;
    const double r = whole - rest, r_rest = (whole - r) - rest;
    const double r2 = r * r, r4 = r2 * r2;
    const double low = (C[0] + C[1] * r) + (C[2] + C[3] * r) * r2;
    const double middle = (C[4] + C[5] * r) + (C[6] + C[7] * r) * r2;
    const double high = (C[8] + C[9] * r) + (C[10] + C[11] * r) * r2;
    const double y = 1.0 + (r + (r_rest + r2 * (low + r4 * (middle + r4 * high))));
    return y * power_of_two(k / 2) * power_of_two(k - k / 2); /* 2^k itself may overflow or vanish too early */
}

/* atan(c) in two parts at the centres c of four intervals in each octave from 1/16 to 16. */
static const double ATAN_OF_CENTRE[][2] = {
    {0.07019697107187052, -1.798192160322046e-18}, {0.08572687577074481, 5.347194143502951e-18},
    {0.10121544166746667, 5.681202558623414e-18}, {0.11665543544106935, 5.487925812108699e-18},
    {0.13970887428916365, -2.9579864247315813e-18}, {0.1702119252854744, -3.541164079802125e-18},
    {0.2003985538258785, 3.1399542871844493e-18}, {0.23021958727684372, 1.2313404529142703e-17},
    {0.2741674511196588, 8.261353575163773e-18}, {0.3310960767041321, -7.952610375793799e-18},
    {0.38588266939807375, 2.378822732491941e-17}, {0.43833655985795783, -2.494277030626541e-17},
    {0.5123894603107377, -2.5462781472855804e-17}, {0.6022873461349642, 2.950430737228402e-17},
    {0.6823165548747481, 6.943223671560008e-18}, {0.7531512809621944, -2.4256934659182068e-17},
    {0.844153986113171, -4.841337011934917e-17}, {0.9420000403794636, 5.4608374858466876e-17},
    {1.0191413442663497, 1.0004018869366799e-17}, {1.0808390005411683, -1.5676322511359073e-17},
    {1.1525719972156676, -9.159738508900379e-17}, {1.2220253232109897, -2.979162864892849e-17},
    {1.2722973952087173, 2.245875015034507e-17}, {1.3101939350475555, 8.745413734780279e-17},
    {1.3521273809209546, 2.147674250751151e-17}, {1.3909428270024184, -9.843712133488843e-17},
    {1.4181469983996315, -8.263883782511014e-17}, {1.4382447944982226, -2.4930199102645656e-17},
    {1.460139105621001, 6.260974707830844e-17}, {1.4801364395941514, 8.50262547607967e-17},
    {1.4940244355251187, -7.47641750277646e-17}, {1.5042281630190728, 9.137781534226847e-18},
};

/* atan(x) = atan(c) + atan(t) with t = (x - c)/(1 + x c), so that |t| <= 1/16 and atan(t) needs few terms. The
 * exponent and the first two bits of the fraction tell the interval of x. */
double portable_atan(double x)
{
    enum { HEAD = 50, FIRST = (1023 - 4) << 2 }; /* bits behind those that tell the interval; head of 1/16 */
    static const double HALF_PI = 1.5707963267948966, HALF_PI_REST = 6.123233995736766e-17;
    const double z = fabs(x);
    double base = 0.0, base_rest = 0.0, t = z;
    if (z >= 16.0) {
        base = HALF_PI;
        base_rest = HALF_PI_REST;
        t = -1.0 / z;
    } else if (z >= 0.0625) {
        const uint64_t head = bits_of(z) >> HEAD;
        const double c = from_bits(head << HEAD | (uint64_t)1 << (HEAD - 1));
        base = ATAN_OF_CENTRE[head - FIRST][0];
        base_rest = ATAN_OF_CENTRE[head - FIRST][1];
        t = (z - c) / (1.0 + z * c);
    }
    const double s = t * t, s2 = s * s;
    const double series = (1.0 / 3.0 - s * (1.0 / 5.0)) + s2 * ((1.0 / 7.0 - s * (1.0 / 9.0))
                        + s2 * (1.0 / 11.0 - s * (1.0 / 13.0)));
    const double angle = base + (t - (t * s * series - base_rest));
    return x < 0.0 ? -angle : angle;
}

double portable_length(double x, double y)
{
    return sqrt(x * x + y * y);
}
