/* What generated C needs of math.h: instructions of WebAssembly, and imports that are JavaScript's Math. */

#ifndef PAGE_MATH_H
#define PAGE_MATH_H

#define INFINITY __builtin_inf()
#define NAN __builtin_nan("")
#define isfinite(x) __builtin_isfinite(x)
#define isnan(x) __builtin_isnan(x)
#define isinf(x) __builtin_isinf(x)
#define fabs(x) __builtin_fabs(x)
#define floor(x) __builtin_floor(x)
#define ceil(x) __builtin_ceil(x)
#define sqrt(x) __builtin_sqrt(x)
#define copysign(x, y) __builtin_copysign(x, y)

static inline double fmin(double x, double y) { return x < y || y != y ? x : y; }
static inline double fmax(double x, double y) { return x > y || y != y ? x : y; }

double sin(double), cos(double), tan(double), asin(double), acos(double), atan(double), atan2(double, double);
double sinh(double), cosh(double), tanh(double), exp(double), log(double), pow(double, double), fmod(double, double);

#endif
