/* Functions that math.h leaves to each platform, with the same bits on all of them.
 *
 * IEEE 754 fixes sqrt and the four operations to the last bit, but not exp, atan or hypot: the libraries of
 * glibc, musl, Windows and macOS differ there, and an unstable wheelset turns a last bit into another run.
 * These are made of the operations that IEEE fixes. Errors are below 1 ulp where the result is normal. */
#ifndef ELEMENTARY_H
#define ELEMENTARY_H

double portable_exp(double x);
double portable_atan(double x);

/* Length of (x, y), of magnitudes whose squares neither overflow nor vanish. */
double portable_length(double x, double y);

#endif
