/* As much of <math.h> as generated code needs, for a compiler that comes without a C library. */
#ifndef MATH_H
#define MATH_H

#define INFINITY __builtin_inff()
#define NAN __builtin_nanf("")
#define fabsf __builtin_fabsf
#define fabs __builtin_fabs

float sqrtf(float x);
double sqrt(double x);

#endif
